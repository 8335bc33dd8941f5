// SPDX-License-Identifier: Apache-2.0
// Every verb of every program: a stream that fails ends it with exit code 1 and a line, and what a
// user has is never harmed.
#include <sys/ioctl.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "nearmesh/core/spm/model_file.hpp"
#include "process.hpp"

namespace nearmesh {
namespace {

namespace fs = std::filesystem;
using test::Folder;
using test::Process;

/// A file that a verb writes. Words in braces are files of the fixture.
struct Written {
  std::string path;
  std::string holder{};  ///< a folder that another kind of file in it makes irreplaceable
};

/// One way to call a verb, whose name is the first word of `words`.
struct Row {
  std::string program, words;
  /// On standard output; else it runs until it is told to stop, and must be silent.
  bool prints = true;
  std::vector<Written> writes{};
  bool needs_publisher = false;
};

const std::string kModel = "nearmesh-model", kPublisher = "nearmesh-publisher",
                  kSubscriber = "nearmesh-subscriber";

const std::vector<Row>& rows() {
  static const std::vector<Row> kRows = {
      {kModel, "generate sphere --size 8 -o {out}.ply", true, {{"{out}.ply"}}},
      {kModel, "build {mesh} -o {out}.spm", true, {{"{out}.spm"}}},
      {kModel, "build --json {mesh} -o {out}.spm", true, {{"{out}.spm"}}},
      {kModel,
       "build --per-node {obj} -o {out}",
       true,
       {{"{out}/scene.yaml"}, {"{out}/left.spm"}, {"{out}/right.spm"}}},
      {kModel, "build-world {mesh} -o {out}"},
      {kModel, "build-world --json {mesh} -o {out}"},
      {kModel, "formats"},
      {kModel, "formats --json"},
      {kModel, "info {model}"},
      {kModel, "info --json {model}"},
      {kModel, "export {model} -o {out}.ply", true, {{"{out}.ply"}}},
      {kModel, "query {model} {model} --poses {poses}"},
      {kModel, "query {model} {model} --poses {poses} --method full --json"},
      {kModel, "probe {model} --rays {rays}"},
      {kModel, "check {model} --answers {answers}"},
      {kPublisher, "serve {model} {bus}", false},
      {kPublisher, "serve --print-config"},
      {kPublisher, "serve --print-config --json"},
      {kPublisher, "replay {session} --rate 1000 --json {bus}"},
      {kPublisher, "replay {session} --print-config"},
      {kPublisher,
       "make-security {out} --publisher alice --force",
       true,
       {{"{out}/alice/key.pem", "{out}/alice"}}},
      {kPublisher, "check-security {set}"},
      {kPublisher, "discovery --listen 127.0.0.1:21811", false},
      {kSubscriber, "run {scene} {bus}", true, {}, true},
      {kSubscriber, "run {scene} --json {bus}", true, {}, true},
      {kSubscriber, "run {scene} --answers {out}.jsonl {bus}", true, {{"{out}.jsonl"}}, true},
      {kSubscriber, "run --print-config"},
      {kSubscriber, "record -o {out}.db3 {bus}", false, {{"{out}.db3"}}},
      {kSubscriber, "record -o {out}.db3 --print-config"},
      {kSubscriber, "info {session}"},
      {kSubscriber, "info --json {session}"},
      {kSubscriber, "verify {session}"},
      {kSubscriber, "export {session} --time 2 --peer {peer} -o {out}.ply", true, {{"{out}.ply"}}},
      {kSubscriber, "export {session} --time 2 --peer {peer} -o {out}.glb", true, {{"{out}.glb"}}},
      {kSubscriber, "report {session} -o {out}", true, {{"{out}/index.html"}}},
      {kSubscriber, "watch --http 18643 {bus}"},
      {kSubscriber, "watch --http 18643 --print-config"},
      {kSubscriber, "status --seconds 1 {bus}", true, {}, true},
      {kSubscriber, "status --seconds 1 --json {bus}", true, {}, true},
      {kSubscriber, "status --print-config"},
      {kSubscriber, "doctor --seconds 3 {bus}", true, {}, true},
      {kSubscriber, "doctor --seconds 3 --json {bus}", true, {}, true},
      {kSubscriber, "doctor --print-config"},
  };
  return kRows;
}

/// What is named under "Subcommands:" in a program's help, where every line of one word and a text
/// is a verb.
std::vector<std::string> verbs_of(const std::string& help) {
  std::vector<std::string> verbs;
  bool in_list = false;
  for (const std::string& line : test::lines_of(help)) {
    if (in_list && line.starts_with("  ") && line[2] != ' ')
      verbs.push_back(line.substr(2, line.find(' ', 2) - 2));
    in_list = in_list || line == "Subcommands:";
  }
  return verbs;
}

struct Ended {
  int code = -1;
  std::string err;
  /// What the program itself says at its end, not the log: "nearmesh-model: ...".
  [[nodiscard]] std::vector<std::string> last_words(const std::string& program) const {
    std::vector<std::string> found;
    for (const std::string& line : test::lines_of(err))
      if (line.starts_with(program + ": ")) found.push_back(line);
    return found;
  }
};

class Output : public ::testing::Test {
 protected:
  Output() {
    folder.write("mesh.stl",
                 "solid t\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 "
                 "0\nendloop\nendfacet\nendsolid t\n");
    folder.write("two.obj",
                 "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\no left\nf 1 2 3\no right\nf 1 2 4\n");
    files = {{"{out}", folder.file("out")},
             {"{mesh}", folder.file("mesh.stl")},
             {"{obj}", folder.file("two.obj")},
             {"{model}", folder.file("ball.spm")},
             {"{poses}", folder.file("poses.csv")},
             {"{rays}", folder.file("rays.csv")},
             {"{answers}", folder.file("answers.jsonl")},
             {"{scene}", folder.file("scene.yaml")},
             {"{session}", folder.file("session.db3")},
             {"{set}", folder.file("set")},
             {"{peer}", "00000000000000b1"}};
    must(kModel, "generate sphere --size 8 -o " + folder.file("ball.ply"));
    must(kModel, "build " + folder.file("ball.ply") + " -o {model}");
    must(kPublisher, "make-security {set} --publisher alice");
    std::string names = "id", numbers = "1";
    for (const char* body : {"A", "B"}) {
      for (int i = 0; i < 9; ++i) {
        names += std::string(",") + body + "_R" + std::to_string(i / 3) + std::to_string(i % 3);
        numbers += i % 4 == 0 ? ",1" : ",0";
      }
      for (int k = 0; k < 3; ++k) {
        names += std::string(",") + body + "_T" + std::to_string(k);
        numbers += body[0] == 'B' ? ",9" : ",0";
      }
    }
    folder.write("poses.csv", names + "\n" + numbers + "\n");
    folder.write("rays.csv", "x,y,z\n0,0,9\n");
    const std::string content =
        to_hex(ModelFile::open(folder.file("ball.spm")).value().content_hash());
    folder.write(
        "answers.jsonl",
        R"({"frame":0,"a":"a","b":"b","model_a":"ball","model_b":"ball","content_a":")" + content +
            R"(","content_b":")" + content +
            R"(","status":"free",)"
            R"("pairs":0,"pose_a":[1,0,0,0,1,0,0,0,1,0,0,0],"pose_b":[1,0,0,0,1,0,0,0,1,9,9,9]})"
            "\n");
    folder.write(
        "scene.yaml",
        "bodies:\n  - {name: fixed, model: ball, pose: {}}\n  - {name: moved, model: "
        "ball}\nmoves:\n  - {body: moved, trajectory: way.csv}\npairs: [[fixed, moved]]\n");
    std::string way = "R00,R01,R02,R10,R11,R12,R20,R21,R22,T0,T1,T2\n";
    for (int i = 0; i < 3; ++i) way += "1,0,0,0,1,0,0,0,1,5,0,0\n";
    folder.write("way.csv", way);
    fs::copy_file(NEARMESH_SESSION_DATA "/session_v1.db3", folder.file("session.db3"));
  }

  /// Names of files in place of the words in braces.
  [[nodiscard]] std::string filled(std::string text) const {
    for (const auto& [name, path] : files)
      for (std::size_t at = text.find(name); at != std::string::npos; at = text.find(name))
        text.replace(at, name.size(), path);
    return text;
  }
  [[nodiscard]] std::vector<std::string> words_of(const std::string& text) const {
    std::vector<std::string> words;
    std::istringstream in(filled(text));
    for (std::string word; in >> word;) {
      if (word == "{bus}") {
        const std::vector<std::string> bus{"--domain",    "97",
                                           "--prefix",    "output-" + std::to_string(::getpid()),
                                           "--interface", "127.0.0.1"};
        words.insert(words.end(), bus.begin(), bus.end());
      } else {
        words.push_back(word);
      }
    }
    return words;
  }
  void must(const std::string& program, const std::string& words) const {
    std::string err;
    ASSERT_EQ(test::run(folder, program, words_of(words), nullptr, &err), 0) << words << err;
  }
  /// `out`: where standard output goes; empty: there is none.
  [[nodiscard]] Ended run(const Row& row, const std::string& out = "/dev/null",
                          bool disk_is_full = false) const {
    std::vector<std::string> words = words_of(row.words);
    words.insert(words.begin(), NEARMESH_BIN_DIR "/" + row.program);
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    int err[2];
    EXPECT_EQ(::pipe(err), 0);  // which no limit of files applies to
    const pid_t pid = ::fork();
    if (pid == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      ::alarm(static_cast<unsigned>(test::kDeadline_s));
      ::dup2(err[1], STDERR_FILENO);
      ::dup2(::open(out.empty() ? "/dev/null" : out.c_str(), O_WRONLY), STDOUT_FILENO);
      for (const int end : err) ::close(end);
      if (out.empty()) ::close(STDOUT_FILENO);
      const rlimit nothing{0, 0};
      if (disk_is_full) {
        std::signal(SIGXFSZ, SIG_IGN);
        ::setrlimit(RLIMIT_FSIZE, &nothing);
      }
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    ::close(err[1]);
    Ended ended;
    char buffer[4096];
    for (ssize_t got = 0; (got = ::read(err[0], buffer, sizeof buffer)) > 0;)
      ended.err.append(buffer, static_cast<std::size_t>(got));
    ::close(err[0]);
    int status = 0;
    ::waitpid(pid, &status, 0);
    ended.code = WIFEXITED(status) ? WEXITSTATUS(status) : 1000 + WTERMSIG(status);
    return ended;
  }
  void serve(const Row& row) {
    if (!row.needs_publisher || publisher) return;
    publisher = std::make_unique<Process>(folder, kPublisher, words_of("serve {model} {bus}"));
    ASSERT_TRUE(publisher->says("ready on domain")) << publisher->err();
  }
  [[nodiscard]] std::map<std::string, std::string> contents() const {
    std::map<std::string, std::string> found;
    for (const auto& entry : fs::recursive_directory_iterator(folder.path()))
      if (entry.is_regular_file() && entry.path().extension() != ".out" &&
          entry.path().extension() != ".err")
        found[entry.path()] = test::read_text(entry.path());
    return found;
  }

  Folder folder;
  std::map<std::string, std::string> files;
  std::unique_ptr<Process> publisher;
};

TEST_F(Output, EveryVerbHasARow) {
  for (const std::string& program : {kModel, kPublisher, kSubscriber}) {
    std::string help;
    ASSERT_EQ(test::run(folder, program, {"--help"}, &help), 0);
    std::set<std::string> in_help, in_table;
    for (const std::string& verb : verbs_of(help)) in_help.insert(verb);
    for (const Row& row : rows())
      if (row.program == program) in_table.insert(row.words.substr(0, row.words.find(' ')));
    EXPECT_GE(in_help.size(), 4U) << help;
    EXPECT_EQ(in_help, in_table) << program;
  }
}

// Also --help of each program and of each verb.
TEST_F(Output, AFullStandardOutputEndsEveryVerb) {
  std::vector<Row> tried = rows();
  std::set<std::string> helps;
  for (const Row& row : rows()) {
    helps.insert(row.program + " --help");
    helps.insert(row.program + " " + row.words.substr(0, row.words.find(' ')) + " --help");
  }
  for (const std::string& help : helps)
    tried.push_back({help.substr(0, help.find(' ')), help.substr(help.find(' ') + 1)});
  for (const Row& row : tried) {
    if (!row.prints) continue;
    SCOPED_TRACE(row.program + " " + row.words);
    serve(row);
    Ended ended;
    std::vector<std::string> said;
    // Who listens for a time that is short and fixed may hear nobody on a busy machine, and says
    // that.
    EXPECT_TRUE(test::await([&] {
      ended = run(row, "/dev/full");
      said = ended.last_words(row.program);
      const bool listens = row.words.starts_with("status") || row.words.starts_with("doctor");
      const bool is_as_expected =
          said.size() == 1 &&
          said[0].starts_with(row.program + ": standard output: cannot write: ");
      return is_as_expected || !listens;
    })) << ended.err;
    EXPECT_EQ(ended.code, 1) << ended.err;
    ASSERT_EQ(said.size(), 1U) << ended.err;
    EXPECT_TRUE(said[0].starts_with(row.program + ": standard output: cannot write: ")) << said[0];
    fs::remove_all(folder.file("out"));
  }
}

TEST_F(Output, VerbsThatRunOnAreSilent) {
  for (const Row& row : rows()) {
    if (row.prints) continue;
    SCOPED_TRACE(row.program + " " + row.words);
    Process process(folder, row.program, words_of(row.words));
    ASSERT_TRUE(process.says(row.program == kPublisher ? "ready" : "recording")) << process.err();
    process.signal(SIGINT);
    EXPECT_EQ(process.wait(), 0) << process.err();
    EXPECT_EQ(process.out(), "");
  }
}

// What is there stays, whole, when the disk is full, and nothing is left beside it.
TEST_F(Output, AFullDiskEndsEveryVerbAndLeavesWhatWasThere) {
  for (const Row& row : rows()) {
    if (row.writes.empty()) continue;
    SCOPED_TRACE(row.program + " " + row.words);
    serve(row);
    const bool is_recording = row.words.starts_with("record");
    if (!is_recording) {  // which never replaces a file
      for (int i = 0; i < 2; ++i) {
        const Ended ended = run(row);
        ASSERT_EQ(ended.code, 0) << "over its own output: " << ended.err;
      }
    }
    const auto before = contents();
    const Ended ended = run(row, "/dev/null", true);
    EXPECT_EQ(ended.code, 1) << ended.err;
    const std::vector<std::string> said = ended.last_words(row.program);
    ASSERT_EQ(said.size(), 1U) << ended.err;
    EXPECT_NE(said[0].find(filled("{out}")), std::string::npos) << said[0];
    EXPECT_EQ(contents(), before);
    for (const char* ending : {"", ".ply", ".spm", ".jsonl", ".glb"})
      fs::remove_all(filled("{out}") + ending);
  }
}

TEST_F(Output, NoVerbReplacesAFileOfAnotherKind) {
  for (const Row& row : rows())
    for (const auto& [path, holder] : row.writes) {
      SCOPED_TRACE(row.program + " " + row.words + ": " + path);
      serve(row);
      const fs::path notes = holder.empty() ? filled(path) : filled(holder) + "/notes.txt";
      fs::create_directories(notes.parent_path());
      std::ofstream(notes) << "notes\n";
      const auto before = contents();
      const Ended ended = run(row);
      EXPECT_EQ(ended.code, 1) << ended.err;
      const std::vector<std::string> said = ended.last_words(row.program);
      ASSERT_EQ(said.size(), 1U) << ended.err;
      EXPECT_NE(said[0].find(notes.string()), std::string::npos) << said[0];
      EXPECT_EQ(contents(), before);
      if (notes.parent_path() != folder.path())
        fs::remove_all(notes.parent_path());
      else
        fs::remove(notes);
    }
}

// Each verb that reads one file and writes another, told to write the one that it reads.
TEST_F(Output, NoVerbReplacesItsInput) {
  const std::vector<std::pair<Row, std::string>> tried = {
      {{kModel, "build {mesh} -o {link}.spm"}, "{mesh}"},
      {{kModel, "export {model} -o {link}.ply"}, "{model}"},
      {{kSubscriber, "run {scene} --answers {link}.jsonl {bus}"}, "{scene}"},
      {{kSubscriber, "export {session} --time 2 --peer {peer} -o {link}.ply"}, "{session}"},
      {{kSubscriber, "export {session} --time 2 --peer {peer} -o {link}.glb"}, "{session}"}};
  const std::string name = folder.file("link");
  files["{link}"] = name;
  for (const auto& [row, input] : tried) {
    SCOPED_TRACE(row.words);
    const std::string target = filled(row.words.substr(row.words.find("{link}")));
    const fs::path link = target.substr(0, target.find(' '));
    const fs::path in = filled(input);
    for (const bool is_hard : {false, true}) {
      is_hard ? fs::create_hard_link(in, link) : fs::create_symlink(in, link);
      const std::string before = test::read_text(in);
      const Ended ended = run(row);
      EXPECT_EQ(ended.code, 1) << ended.err;
      const std::vector<std::string> said = ended.last_words(row.program);
      ASSERT_EQ(said.size(), 1U) << ended.err;
      EXPECT_NE(said[0].find("is the input " + in.string()), std::string::npos) << said[0];
      EXPECT_EQ(test::read_text(in), before);
      fs::remove(link);
    }
  }
  for (const std::string& spelling : {std::string("{mesh}"), folder.path() + "/./mesh.stl"}) {
    const Ended ended = run({kModel, "build {mesh} -o " + spelling});
    EXPECT_EQ(ended.code, 1);
    EXPECT_NE(ended.err.find("is the input"), std::string::npos) << ended.err;
  }
}

TEST_F(Output, AnswersToAFullDeviceEndTheFlight) {
  const Row row{kSubscriber, "run {scene} --answers /dev/full {bus}", true, {}, true};
  serve(row);
  const Ended ended = run(row);
  EXPECT_EQ(ended.code, 1);
  EXPECT_EQ(ended.last_words(kSubscriber),
            std::vector<std::string>{
                "nearmesh-subscriber: /dev/full: cannot write: No space left on device"})
      << ended.err;
}

// Names of files are bytes, JSON is UTF-8.
TEST_F(Output, WhatIsPrintedIsJsonWhateverFilesAreCalled) {
  files["{latin}"] = folder.file("b\xe4ll");
  for (const auto& [from, ending] :
       {std::pair("{mesh}", ".stl"), {"{model}", ".spm"}, {"{session}", ".db3"}})
    fs::copy_file(filled(from), filled("{latin}") + ending);
  for (const Row& row :
       std::vector<Row>{{kModel, "info --json {latin}.spm"},
                        {kModel, "build --json {latin}.stl -o {out}.spm"},
                        {kModel, "build-world --json {mesh} -o {latin}"},
                        {kModel, "info --json {latin}"},
                        {kPublisher, "replay {latin}.db3 --rate 1000 --json {bus}"}}) {
    std::string out, err;
    EXPECT_EQ(test::run(folder, row.program, words_of(row.words), &out, &err), 0) << err;
    EXPECT_TRUE(nlohmann::json::accept(out)) << row.words << "\n" << out;
  }
}

// On the page that is named: who reads what a program prints must know what it means.
TEST_F(Output, EachFieldOfAModelAndAWorldIsWrittenDown) {
  for (const auto& [words, page] : std::vector<std::pair<std::string, std::string>>{
           {"build --json {mesh} -o {out}.spm", "import"},
           {"info --json {out}.spm", "import"},
           {"build-world --json {mesh} -o {out}", "worlds"},
           {"info --json {out}", "worlds"}}) {
    const std::string text = test::read_text(NEARMESH_DOCS_DIR "/" + page + ".md");
    std::string out, err;
    ASSERT_EQ(test::run(folder, kModel, words_of(words), &out, &err), 0) << err;
    const nlohmann::json report = nlohmann::json::parse(out);
    EXPECT_GT(report.size(), 10U) << words;
    for (const auto& [field, value] : report.items())
      EXPECT_NE(text.find("`" + field + "`"), std::string::npos)
          << field << " of " << words << " is not in docs/" << page << ".md";
  }
}

TEST_F(Output, WhatIsNoNumberIsWrongUsage) {
  for (const Row& row : std::vector<Row>{{kModel, "build {mesh} -o {out}.spm --cell nan"},
                                         {kSubscriber, "status --seconds nan {bus}"},
                                         {kSubscriber, "export {session} --time nan -o {out}.ply"},
                                         {kSubscriber, "run {scene} --wait-recorder=nan {bus}"}}) {
    const Ended ended = run(row);
    EXPECT_EQ(ended.code, 2) << row.words;
    EXPECT_NE(ended.err.find("expected a number, found nan"), std::string::npos) << ended.err;
  }
}

// What is not known is not right.
TEST_F(Output, CheckRefusesAnswersOfAnUnknownStatus) {
  std::string answers = test::read_text(filled("{answers}"));
  answers.replace(answers.find("free"), 4, "fine");
  folder.write("answers.jsonl", answers);
  const Ended ended = run({kModel, "check {model} --answers {answers}"});
  EXPECT_EQ(ended.code, 1);
  EXPECT_NE(ended.err.find("answers.jsonl:1: no answer has the status fine"), std::string::npos)
      << ended.err;
}

// Nobody reads from the pipe, so each waits until it is told to stop.
TEST_F(Output, VerbsThatDoNotRunOnEndAtOnceWhenInterrupted) {
  ASSERT_EQ(::mkfifo(folder.file("pipe.ply").c_str(), 0600), 0);
  files["{pipe}"] = folder.file("pipe.ply");
  for (const int signal : {SIGINT, SIGTERM}) {
    Process process(folder, kSubscriber,
                    words_of("export {session} --time 2 --peer {peer} -o {pipe}"));
    test::pause(1);
    process.signal(signal);
    EXPECT_NE(process.wait(), 0) << process.err();
    EXPECT_EQ(process.out(), "");
  }
}

// --- Ctrl-C

// A flight waits until somebody opens the pipe to read, and for whoever then does not read.
TEST_F(Output, AFlightEndsWhenInterruptedThoughNobodyReadsItsAnswers) {
  serve({kSubscriber, "", true, {}, true});
  ASSERT_EQ(::mkfifo(folder.file("pipe").c_str(), 0600), 0);
  const std::string scene = test::read_text(filled("{scene}")) + "duration_s: 600\n";
  folder.write("long.yaml", scene);
  files["{long}"] = folder.file("long.yaml");
  files["{pipe}"] = folder.file("pipe");
  const auto interrupted = [&](double after_s, const std::function<void(Process&)>& look) {
    Process process(folder, kSubscriber, words_of("run {long} --answers {pipe} {bus}"));
    EXPECT_TRUE(process.says("joined domain")) << process.err();
    look(process);
    test::pause(after_s);
    process.signal(SIGINT);
    const int code = process.wait(test::kEnd_s);
    if (code == 0) return false;
    EXPECT_EQ(code, 1) << process.err();
    EXPECT_NE(process.err().find("pipe: cannot "), std::string::npos) << process.err();
    return true;
  };
  {
    SCOPED_TRACE("nobody opens");
    // It opens the pipe with its first frame; before, there is nothing to be told.
    bool has_waited = false;
    for (double after_s = 1; after_s <= 64 && !has_waited && !HasFailure(); after_s *= 2)
      has_waited = interrupted(after_s, [](Process&) {});
    EXPECT_TRUE(has_waited);
  }
  SCOPED_TRACE("nobody reads");
  const int reader = ::open(folder.file("pipe").c_str(), O_RDWR | O_CLOEXEC);
  ASSERT_GT(::fcntl(reader, F_SETPIPE_SZ, 4096), 0);
  EXPECT_TRUE(interrupted(0, [&](Process& process) {
    int waits = 0, before = 0;  // until the pipe is full
    EXPECT_TRUE(test::await([&] {
      test::pause(0.2);
      ::ioctl(reader, FIONREAD, &waits);
      return waits > 1500 && waits == std::exchange(before, waits);
    })) << process.err();
  }));
  ::close(reader);
}

TEST_F(Output, StatusEndsWhenInterruptedThoughNobodyReadsIt) {
  serve({kSubscriber, "", true, {}, true});
  std::array<int, 2> pipe{};
  ASSERT_EQ(::pipe2(pipe.data(), O_CLOEXEC), 0);
  ASSERT_GT(::fcntl(pipe[0], F_SETPIPE_SZ, 4096), 0);
  std::vector<std::string> words = words_of("status --watch --json --seconds 0.1 {bus}");
  words.insert(words.begin(), NEARMESH_BIN_DIR "/" + kSubscriber);
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  const pid_t pid = ::fork();
  if (pid == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    ::dup2(pipe[1], STDOUT_FILENO);
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  int waits = 0, before = 0;
  EXPECT_TRUE(test::await([&] {
    test::pause(0.5);
    ::ioctl(pipe[0], FIONREAD, &waits);
    return waits > 2000 && waits == std::exchange(before, waits);
  }));
  ::kill(pid, SIGINT);
  int status = 0;
  const bool is_over =
      test::await([&] { return ::waitpid(pid, &status, WNOHANG) == pid; }, test::kEnd_s);
  EXPECT_TRUE(is_over);
  if (is_over) {
    EXPECT_TRUE(WIFEXITED(status)) << status;
    EXPECT_EQ(WEXITSTATUS(status), 1) << "what was printed is lost";
  } else {
    ::kill(pid, SIGKILL);
    ::waitpid(pid, &status, 0);
  }
  for (const int end : pipe) ::close(end);
}

// Nobody serves, so it waits for its first frame.
TEST_F(Output, AFlightThatEndsBeforeItsFirstFrameLeavesOlderAnswers) {
  const std::string old = "{\"frame\":0,\"kept\":true}\n";
  folder.write("old.jsonl", old);
  files["{old}"] = folder.file("old.jsonl");
  Process process(folder, kSubscriber, words_of("run {scene} --answers {old} {bus}"));
  ASSERT_TRUE(process.says("joined domain")) << process.err();
  test::pause(1);
  process.signal(SIGINT);
  EXPECT_EQ(process.wait(test::kEnd_s), 0) << process.err();
  EXPECT_NE(process.out(), "") << "there is no summary";
  EXPECT_EQ(test::read_text(filled("{old}")), old);
}

// With no standard output at all, what is printed must not end up in a file that is being written.
TEST_F(Output, WithoutAStandardOutputNoFileTakesItsPlace) {
  must(kModel, "build {mesh} -o {out}.spm");
  const std::string whole = test::read_text(filled("{out}.spm"));
  const Ended ended = run({kModel, "build {mesh} -o {out}2.spm"}, "");
  EXPECT_EQ(ended.code, 1);
  EXPECT_NE(ended.err.find("standard output: cannot write: Bad file descriptor"), std::string::npos)
      << ended.err;
  EXPECT_EQ(test::read_text(filled("{out}2.spm")), whole);
}

}  // namespace
}  // namespace nearmesh
