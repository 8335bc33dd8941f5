// SPDX-License-Identifier: Apache-2.0
// Sessions from files and on DDS, and their options.

#include <algorithm>
#include <atomic>
#include <exception>
#include <functional>
#include <thread>
#include <vector>

#include "bindings.hpp"
#include "nearmesh/subscriber/dds/dds_channel.hpp"
#include "nearmesh/subscriber/peer/local_channel.hpp"
#include "peer.hpp"

namespace nearmesh::python {

using subscriber::Session;

namespace {

/// Jobs of a frame on so many threads, the caller's among them.
subscriber::RunJobs jobs_on(unsigned threads) {
  if (threads < 2) return {};
  return [threads](std::size_t count, const std::function<void(std::size_t)>& job) {
    std::atomic<std::size_t> next{0};
    const auto work = [&] {
      for (std::size_t i = next++; i < count; i = next++) job(i);
    };
    const std::size_t wanted = std::min<std::size_t>(threads, count) - 1;
    std::vector<std::thread> others;
    others.reserve(wanted);
    try {
      while (others.size() < wanted) others.emplace_back(work);
    } catch (const std::exception&) {
      // There is no room for more threads: those that there are do it all.
    }
    work();
    for (std::thread& other : others) other.join();
  };
}

/// Jobs of a frame as Python's callable spreads them: run_jobs(count, job) calls job(i) for each i
/// below count, on whichever threads, and returns when all are done. A job runs without the
/// interpreter's lock. What the callable raised is raised by update().
subscriber::RunJobs jobs_of(py::function run) {
  // Let go under the lock, wherever the session ends.
  const std::shared_ptr<py::function> held(new py::function(std::move(run)), [](py::function* f) {
    const py::gil_scoped_acquire lock;
    delete f;
  });
  return [held](std::size_t count, const std::function<void(std::size_t)>& job) {
    struct Jobs {
      Jobs(std::size_t jobs, const std::function<void(std::size_t)>& of) : states(jobs), run(&of) {}
      std::vector<std::atomic<bool>> states;  // begun
      std::atomic<std::size_t> done{0};
      const std::function<void(std::size_t)>* run;  // throws nothing
      void work(std::size_t i) {
        if (i >= states.size() || states[i].exchange(true)) return;
        (*run)(i);
        ++done;
      }
    };
    // The callable may keep its job beyond the frame; it does nothing then.
    const auto jobs = std::make_shared<Jobs>(count, job);
    std::exception_ptr fault;
    {
      const py::gil_scoped_acquire lock;
      try {
        (*held)(count, py::cpp_function([jobs](std::size_t i) {
                  const py::gil_scoped_release others_may_run;
                  jobs->work(i);
                }));
      } catch (...) {
        fault = std::current_exception();
      }
    }
    for (std::size_t i = 0; i < count; ++i) jobs->work(i);
    while (jobs->done != count) std::this_thread::yield();
    if (fault) std::rethrow_exception(fault);
  };
}

subscriber::SessionOptions session_options(const py::kwargs& given) {
  subscriber::SessionOptions options;
  for (const auto& [key, value] : given) {
    const std::string name = py::cast<std::string>(key);
    if (name == "max_pose_age_s") {
      options.max_pose_age_s = given_as<double>(value, name);
    } else if (name == "lookahead_s") {
      options.lookahead_s = given_as<double>(value, name);
    } else if (name == "margin_m") {
      options.margin_m = given_as<double>(value, name);
    } else if (name == "sweep_s") {
      options.sweep_s = given_as<double>(value, name);
    } else if (name == "request_timeout_s") {
      options.request_timeout_s = given_as<double>(value, name);
    } else if (name == "max_held_splits") {
      options.max_held_splits = given_as<std::uint32_t>(value, name);
    } else if (name == "window_bytes") {
      options.window_bytes = given_as<std::uint32_t>(value, name);
    } else if (name == "audit_s") {
      options.audit_s = given_as<double>(value, name);
    } else if (name == "clearance") {
      options.clearance = clearance_of(given_as<std::string>(value, name));
    } else if (name == "cache_folder") {
      options.cache_folder = given_as<std::string>(value, name);
    } else if (name == "contacts") {
      options.contacts = given_as<bool>(value, name);
    } else if (name == "depth") {
      options.depth = given_as<bool>(value, name);
    } else if (name == "publish_reports") {
      options.publish_reports = given_as<bool>(value, name);
    } else if (name == "any") {
      options.any = given_as<bool>(value, name);
    } else if (name == "max_pairs") {
      options.max_pairs = given_as<std::size_t>(value, name);
    } else if (name == "max_tests") {
      options.max_tests = given_as<std::uint64_t>(value, name);
    } else if (name == "max_sweep_tests") {
      options.max_sweep_tests = given_as<std::uint64_t>(value, name);
    } else if (name == "max_depth_tests") {
      options.max_depth_tests = given_as<std::uint64_t>(value, name);
    } else if (name == "promise_s") {
      options.promise_s = given_as<double>(value, name);
    } else if (name == "run_jobs") {
      options.run_jobs = jobs_of(py::cast<py::function>(value));
    } else if (name == "threads") {
      options.run_jobs = jobs_on(given_as<unsigned>(value, name));
    } else {
      throw py::type_error("unexpected option " + name + "; help(nearmesh.Session) lists them");
    }
  }
  need(subscriber::check(options));
  return options;
}

}  // namespace

std::unique_ptr<Peer> local_session(const std::map<std::string, std::string>& models,
                                    const std::map<std::string, std::string>& worlds,
                                    const py::kwargs& given) {
  auto channel = std::make_unique<subscriber::LocalChannel>();
  for (const auto& [name, path] : models)
    need(channel->add_model(name, need(ModelFile::open(path))));
  for (const auto& [name, folder] : worlds) need(channel->add_world(name, folder));
  auto peer = std::make_unique<Peer>();
  peer->session = std::make_unique<Session>(std::move(channel), session_options(given));
  return peer;
}

std::unique_ptr<Peer> dds_session(Whole<std::uint32_t> domain, const std::string& interface,
                                  const std::string& name, const std::string& prefix,
                                  const std::string& transport, const std::string& security,
                                  const std::vector<std::string>& initial_peers,
                                  const std::string& discovery_server, const py::kwargs& given) {
  const auto by_name = wire::transport_of(transport);
  if (!by_name)
    refuse("transport: expected lan, thin, tcp, udp-only or same-host, found " + transport);
  subscriber::DdsChannelOptions options;
  options.transport = wire::preset_of(*by_name);
  options.transport.domain = domain;
  options.transport.interface = interface;
  options.transport.name = name;
  options.transport.prefix = prefix;
  options.transport.security = security;
  options.transport.initial_peers = initial_peers;
  options.transport.discovery_server = discovery_server;
  subscriber::SessionOptions session = session_options(given);
  auto channel = [&] {
    const py::gil_scoped_release others_may_run;
    return subscriber::DdsChannel::create(options);
  }();
  auto peer = std::make_unique<Peer>();
  peer->session = std::make_unique<Session>(need(std::move(channel)), std::move(session));
  return peer;
}

}  // namespace nearmesh::python
