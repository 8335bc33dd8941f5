// SPDX-License-Identifier: Apache-2.0
// What a doctor says that its user has interrupted: what it had measured by then, and no more.
#include "subscriber/program/doctor_findings.hpp"

#include <gtest/gtest.h>

namespace nearmesh::subscriber::program {
namespace {

using Kind = Finding::Kind;

bool says(const Finding& finding, const std::string& part) {
  return finding.text.find(part) != std::string::npos;
}

TEST(DoctorFindings, LossIsOfWhatWasSentUntilTheInterruption) {
  const Finding finding = finding_of(Probes{.sent = 40, .back = 40, .is_interrupted = true});
  EXPECT_EQ(finding.kind, Kind::kGood) << finding.text;
  EXPECT_EQ(finding.value, 0.0);
  EXPECT_TRUE(says(finding, "0.0 % of 40 kilobytes there and back; interrupted")) << finding.text;
}

TEST(DoctorFindings, LossThatWasSeenIsWrongAlsoWhenInterrupted) {
  const Finding finding = finding_of(Probes{.sent = 100, .back = 80, .is_interrupted = true});
  EXPECT_EQ(finding.kind, Kind::kWrong);
  EXPECT_TRUE(says(finding, "20.0 % of 100")) << finding.text;
  EXPECT_TRUE(says(finding, "try --transport thin")) << finding.text;
}

TEST(DoctorFindings, WhatWasNotBegunWasNotMeasured) {
  for (const Finding& finding :
       {finding_of(Probes{.is_interrupted = true}),
        finding_of(RoundTrips{.name = "1 kB", .bytes = kKilobyte, .is_interrupted = true})}) {
    EXPECT_EQ(finding.kind, Kind::kFact);
    EXPECT_EQ(finding.text, "not measured: interrupted");
    EXPECT_TRUE(finding.value.is_null());
  }
}

TEST(DoctorFindings, AnAnswerThatWasInterruptedIsNotOverdue) {
  RoundTrips trips{.name = "1 kB", .bytes = kKilobyte, .times_s = {0.003, 0.001, 0.002}};
  trips.patience_s = 1;
  trips.is_overdue = true;
  const Finding late = finding_of(trips);
  EXPECT_EQ(late.kind, Kind::kWrong);
  EXPECT_TRUE(says(late, "1000 bytes there and back: not within 1.0")) << late.text;
  trips.is_interrupted = true;
  const Finding finding = finding_of(trips);
  EXPECT_EQ(finding.kind, Kind::kGood) << finding.text;
  EXPECT_EQ(finding.value.at("count"), 3);
  EXPECT_EQ(finding.value.at("median_s"), 0.002);
  EXPECT_TRUE(says(finding, "interrupted")) << finding.text;
}

}  // namespace
}  // namespace nearmesh::subscriber::program
