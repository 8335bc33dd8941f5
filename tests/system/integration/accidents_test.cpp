// SPDX-License-Identifier: Apache-2.0
// The programs on machines that lack something: a line and an exit code, never a signal; and what
// --json prints parses.

#include <nlohmann/json.hpp>

#include "process.hpp"

namespace nearmesh {
namespace {

class Accidents : public ::testing::Test {
 protected:
  test::Folder accident_folder;

  struct Outcome {
    int code = 0;  ///< as a shell tells it: 128 and more for a signal
    std::string out, err;
  };
  /// `lack`: shell commands that take something away from the program.
  Outcome suffer(const std::string& lack, const std::string& program) const {
    const std::string out = accident_folder.file("out"), err = accident_folder.file("err");
    const std::string domain = std::to_string(180 + ::getpid() % 20);
    const std::string script = lack + "; exec timeout -s INT -k 5 100 " NEARMESH_BIN_DIR "/" +
                               program + " --domain " + domain + " --prefix accident-" +
                               std::to_string(::getpid()) + " >" + out + " 2>" + err;
    accident_folder.write("script", script);
    const int status = std::system(
        ("unshare -m -n bash " + accident_folder.file("script") + " 2>/dev/null").c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status), test::read_text(out),
            test::read_text(err)};
  }
  static void expect_json(const Outcome& outcome, const std::string& what) {
    for (const std::string& line : test::lines_of(outcome.out))
      EXPECT_TRUE(nlohmann::json::accept(line)) << what << ": " << line;
  }
  void SetUp() override {
    if (std::system("unshare -m -n true 2>/dev/null") != 0) GTEST_SKIP() << "namespaces need root";
    accident_folder.write("flight.csv",
                          "R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n"
                          "1,0,0,0,1,0,0,0,1,0,0,500\n1,0,0,0,1,0,0,0,1,1,0,500\n");
    accident_folder.write("scene.yaml",
                          "bodies:\n  - {name: ground, model: terrain, pose: {translation: [0, 0, "
                          "0]}}\n  - {name: one, model: aircraft}\nmoves:\n  - {body: one, "
                          "trajectory: flight.csv}\npairs: [[ground, one]]\n"
                          "start_timeout_s: 1\n");
  }
};

const std::string kLoopbackUp = "ip link set lo up";

TEST_F(Accidents, EndInALineAndNotInASignal) {
  struct Lack {
    std::string name, commands, flags, expected;
  };
  const std::string small = "mount -t tmpfs -o size=1M tmpfs /dev/shm";
  for (const Lack& lack :
       std::vector<Lack>{{"descriptors", kLoopbackUp + "; ulimit -n 16", "--interface 127.0.0.1",
                          "cannot join: it takes 32 more open files, only "},
                         {"memory", kLoopbackUp + "; ulimit -v 100000", "--interface 127.0.0.1",
                          "cannot join: it takes "},
                         {"shared memory", kLoopbackUp + "; " + small, "--transport same-host",
                          "of /dev/shm, where 1024 KiB are free: make it larger"},
                         {"no shared memory", kLoopbackUp + "; mount -t tmpfs -o ro tmpfs /dev/shm",
                          "--transport same-host", "same-host needs /dev/shm"}}) {
    for (const std::string& program : std::vector<std::string>{
             "nearmesh-subscriber status --seconds 0.5 --json",
             "nearmesh-subscriber doctor --seconds 2 --json",
             "nearmesh-subscriber run " + accident_folder.file("scene.yaml") + " --json",
             "nearmesh-subscriber record -o " +
                 accident_folder.file(lack.name.substr(0, 2) + ".db3"),
             "nearmesh-publisher serve " + test::model_file("terrain", 48)}) {
      const std::string what = lack.name + ": " + program;
      const Outcome outcome = suffer(lack.commands, program + " " + lack.flags);
      EXPECT_EQ(outcome.code, 1) << what << outcome.err;
      expect_json(outcome, what);
      const bool is_doctor = program.find("doctor") != std::string::npos;
      EXPECT_NE((is_doctor ? outcome.out : outcome.err).find(lack.expected), std::string::npos)
          << what << ": " << outcome.out << outcome.err;
      if (!is_doctor) continue;
      ASSERT_TRUE(nlohmann::json::accept(outcome.out)) << what;
      EXPECT_EQ(nlohmann::json::parse(outcome.out).at("healthy"), false) << what;
    }
  }
}

TEST_F(Accidents, OfTheNetworkAreToldByDoctor) {
  struct Lack {
    std::string name, commands, expected;
  };
  const std::string cable = kLoopbackUp +
                            "; ip link add va type veth peer name vb; ip addr add 10.9.0.1/24 dev "
                            "va; ip link set va up; ip link set vb up";
  for (const Lack& lack : std::vector<Lack>{
           {"no network", "true", "no interface but loopback is up"},
           {"no multicast", cable + "; ip link set va multicast off",
            "no interface that is used is marked for multicast (va 10.9.0.1)"},
           {"small packets", cable + "; ip link set va mtu 576", "nobody was found"},
           {"large packets", cable + "; ip link set va mtu 9000", "nobody was found"}}) {
    const Outcome doctor = suffer(lack.commands, "nearmesh-subscriber doctor --seconds 2 --json");
    EXPECT_EQ(doctor.code, 1) << lack.name << doctor.err;
    ASSERT_TRUE(nlohmann::json::accept(doctor.out)) << lack.name << doctor.out << doctor.err;
    EXPECT_NE(doctor.out.find(lack.expected), std::string::npos) << lack.name << doctor.out;
    const Outcome status = suffer(lack.commands, "nearmesh-subscriber status --seconds 1 --json");
    EXPECT_EQ(status.code, 1) << lack.name << status.err;
    expect_json(status, lack.name);
    EXPECT_FALSE(status.out.empty()) << lack.name;
    EXPECT_NE(status.err.find("nobody was heard"), std::string::npos) << lack.name << status.err;
  }
}

}  // namespace
}  // namespace nearmesh
