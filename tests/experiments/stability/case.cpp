// SPDX-License-Identifier: Apache-2.0
#include "case.hpp"

#include <algorithm>
#include <cstdio>

namespace nearmesh::stability {
namespace {

using Kind = Verdict::Kind;

Mark right_if(bool right) { return right ? Mark::kRight : Mark::kWrong; }

bool tells_truth(const Case& asked, const Verdict& verdict) {
  return verdict.kind == (asked.touches ? Kind::kTouches : Kind::kFree);
}

}  // namespace

Mark judge(const Case& asked, const Verdict& verdict) {
  switch (verdict.kind) {
    case Kind::kNotOffered:
      return Mark::kNotApplicable;
    case Kind::kCrashed:
      return Mark::kCrash;
    case Kind::kHung:
      return Mark::kHang;
    default:
      break;
  }
  switch (asked.question) {
    case Question::kTouch:
    case Question::kSolids:
    case Question::kThreads:
    case Question::kBounds:
    case Question::kIncremental:
      return right_if(tells_truth(asked, verdict));
    case Question::kPairs:
      if (!verdict.has_pairs && verdict.kind != Kind::kRefused) return Mark::kNotApplicable;
      return right_if(tells_truth(asked, verdict) && verdict.pairs == asked.pairs);
    case Question::kContacts:
      return right_if(tells_truth(asked, verdict) &&
                      verdict.position_error_m <= asked.position_tolerance_m &&
                      verdict.normal_error_rad <= asked.normal_tolerance_rad);
    case Question::kStream:
    case Question::kSweep:
      if (verdict.kind == Kind::kUndecided) return Mark::kUndecided;
      return right_if(tells_truth(asked, verdict));
    case Question::kLimit:
      return right_if(verdict.says_incomplete == (asked.pairs > asked.limit) &&
                      verdict.pairs == std::min<std::uint64_t>(*asked.pairs, asked.limit));
    case Question::kInvalid:
      return right_if(verdict.kind == Kind::kRefused);
    case Question::kExtreme:
      return right_if(verdict.kind == Kind::kRefused || tells_truth(asked, verdict));
    case Question::kFile:
      return right_if(asked.file_rule == FileRule::kEither ||
                      (verdict.kind == Kind::kRefused) == (asked.file_rule == FileRule::kReject));
  }
  return Mark::kWrong;
}

Case as_pairs(Case asked) {
  asked.question = Question::kPairs;
  return asked;
}

const char* to_string(Kind kind) {
  switch (kind) {
    case Kind::kFree:
      return "free";
    case Kind::kTouches:
      return "touches";
    case Kind::kUndecided:
      return "undecided";
    case Kind::kRefused:
      return "refused";
    case Kind::kNotOffered:
      return "not offered";
    case Kind::kContradicts:
      return "contradicts itself";
    case Kind::kCrashed:
      return "crashed";
    case Kind::kHung:
      return "no answer in time";
  }
  return "unknown";
}

std::string describe_truth(const Case& asked) {
  switch (asked.question) {
    case Question::kInvalid:
      return "refuse";
    case Question::kExtreme:
      return std::string("refuse, or ") + (asked.touches ? "touches" : "free");
    case Question::kFile:
      return asked.file_rule == FileRule::kLoad ? "load" : "refuse";
    case Question::kBounds:
    case Question::kIncremental:
      return "holds";
    case Question::kLimit:
      return "at most " + std::to_string(asked.limit) + " of " + std::to_string(*asked.pairs) +
             " pairs";
    case Question::kContacts: {
      char tolerance[64];
      std::snprintf(tolerance, sizeof tolerance, "touches, normals within %.2g rad",
                    asked.normal_tolerance_rad);
      return tolerance;
    }
    case Question::kPairs:
      return std::to_string(*asked.pairs) + " pairs";
    default:
      return asked.touches ? "touches" : "free";
  }
}

std::string describe(const Verdict& verdict) {
  std::string text = to_string(verdict.kind);
  if (verdict.has_pairs) text += ", " + std::to_string(verdict.pairs) + " pairs";
  if (verdict.position_error_m > 0 || verdict.normal_error_rad > 0) {
    char errors[96];
    std::snprintf(errors, sizeof errors, ", points off by %.2g m, normals by %.2g rad",
                  verdict.position_error_m, verdict.normal_error_rad);
    text += errors;
  }
  if (verdict.says_incomplete) text += " (more not listed)";
  return text;
}

}  // namespace nearmesh::stability
