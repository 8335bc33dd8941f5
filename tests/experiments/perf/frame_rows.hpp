// SPDX-License-Identifier: Apache-2.0
#pragma once
// What a host waits for: all of Session::update, with everything that a default session does.

#include "report.hpp"
#include "workloads.hpp"

namespace nearmesh::perf {

/// Aircraft over a terrain: 1, 16, 40 and 200 of them, 20, 100 and 1,000 frames a second, on the
/// detail that the session asks for and on all of it; 40 of them with all pairs watched by name;
/// one that always touches. Adds a row of each frame's time: mean, median, 99th percentile, worst.
void time_flights(const Model& terrain, const Model& aircraft, Report& report);

/// The model twice: one goes from a near miss a ten thousandth of its size away in each frame,
/// fifty frames long, and comes back.
void time_near_miss(const std::string& name, const Model& model, Report& report);

}  // namespace nearmesh::perf
