// SPDX-License-Identifier: Apache-2.0
#include "html_page.hpp"

#include "core/base/counted.hpp"
#include "core/base/hash.hpp"
#include "html_parts.hpp"
#include "idl/messages/process_name.hpp"
#include "nearmesh/core/query/query.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "player_page.hpp"
#include "subscriber/recorded/survey.hpp"

namespace nearmesh::subscriber::report {
namespace {

// Colours of statuses and peers are told apart with any colour vision (Okabe and Ito), on light and
// on dark.
constexpr const char* kStyle = R"css(
:root{color-scheme:light dark;--back:#fff;--text:#1c2430;--dim:#556070;--line:#c9d0d8;--grid:#e8ecf0;--panel:#f5f7f9;
--free:#009e73;--contact:#d6006c;--partial:#cc79a7;--uncertain:#f0a000;--contained:#56b4e9;--bytes:#0072b2}
@media(prefers-color-scheme:dark){:root{--back:#14181d;--text:#e6eaef;--dim:#a4adb8;--line:#47505b;--grid:#2a313a;
--panel:#1d232a;--bytes:#56a8dc}}
body{margin:0;background:var(--back);color:var(--text);font:16px/1.5 system-ui,sans-serif}
main{margin:0 auto;max-width:62rem;padding:0 1.5rem 1.5rem}
header{display:flex;flex-wrap:wrap;gap:0 1.2rem;align-items:baseline;padding:.5rem .8rem;border-bottom:1px solid var(--line)}
header p{margin:0;color:var(--dim)}.none{padding:0 .8rem}
h1{font-size:1.2rem;margin:0}h2{font-size:1.2rem;margin:2.2rem 0 .6rem;border-bottom:1px solid var(--line)}
p.dim,figcaption{color:var(--dim)}figcaption{font-size:.9rem}
figure{margin:1rem 0 1.6rem}figure>svg{width:100%;height:auto;background:var(--panel);border-radius:6px}
svg text{font:12px system-ui,sans-serif;fill:var(--dim)}
.axis{stroke:var(--dim)}.grid{stroke:var(--grid)}
.s0{fill:var(--free)}.s1{fill:var(--contact)}.s2{fill:var(--partial)}.s3{fill:var(--uncertain)}.s4{fill:var(--contained)}
.bytes{fill:var(--bytes)}
.p0{--c:#0072b2}.p1{--c:#d55e00}.p2{--c:#009e73}.p3{--c:#cc79a7}.p4{--c:#e69f00}.p5{--c:#56b4e9}.p6{--c:#8a929c}
.p7{--c:#b8a200}
.fill{fill:var(--c);fill-opacity:.75}.stroke{fill:none;stroke:var(--c);stroke-width:2}
table{border-collapse:collapse;font-size:.9rem;font-variant-numeric:tabular-nums}
th,td{padding:.2rem .7rem .2rem 0;text-align:left;border-bottom:1px solid var(--grid)}caption{text-align:left}
.scroll{overflow-x:auto}.legend{list-style:none;display:flex;flex-wrap:wrap;gap:.2rem 1.1rem;margin:.3rem 0;padding:0}
.swatch{width:.8em;height:.8em}
)css";

std::string summary_section(const RecordingReader& recording, const Survey& survey) {
  std::string out = "<section id=\"summary\"><h2>Summary</h2><div class=\"scroll\"><table>";
  const auto row = [&](const std::string& head, const std::string& cell) {
    out += "<tr><th scope=\"row\">" + head + "</th><td>" + cell + "</td></tr>";
  };
  row("Duration", number(survey.duration_s, 6) + " s");
  row("Files", std::to_string(recording.parts()));
  row("Publishers, peers",
      std::to_string(survey.publishers.size()) + ", " + std::to_string(survey.peers.size()));
  for (const auto& [id, name] : survey.names)
    row(survey.publishers.contains(id) ? "Publisher" : "Peer",
        escape(name) + ", <code>" + wire::partition_of(id) + "</code>");
  std::string answers;
  for (std::size_t i = 0; i < survey.by_status.size(); ++i)
    answers += (i == 0 ? "" : ", ") + std::to_string(survey.by_status[i]) + " " +
               to_string(static_cast<AnswerStatus>(i));
  row("Answers", answers);
  row("Touching face pairs", std::to_string(survey.contact_pairs));
  if (const auto& times = survey.to_certified_s; !times.empty())
    row("Seconds to certified", number(times.front()) + " / " + number(times[times.size() / 2]) +
                                    " / " + number(times.back()) + " (min, median, max of " +
                                    std::to_string(times.size()) + " times)");
  for (const auto& [hash, model] : survey.models)
    row("Model " + escape(model.name),
        std::to_string(model.faces) + " faces, <code>" + to_hex(hash) + "</code>");
  out +=
      "</table></div><div class=\"scroll\"><table><caption>Samples</caption><tr><th>topic</th>"
      "<th>samples</th><th>bytes</th><th>missing</th></tr>";
  for (std::size_t i = 0; i < survey.topics.size(); ++i)
    out += "<tr><td>" + escape(recording.topics()[i].name) + "</td><td>" +
           std::to_string(survey.topics[i].samples) + "</td><td>" +
           std::to_string(survey.topics[i].bytes) + "</td><td>" +
           std::to_string(survey.topics[i].missing) + "</td></tr>";
  return out + "</table></div></section>\n";
}

/// "e3a90c5b11d8a7f0 (rig-2)", of a peer's partition.
std::string with_name(const std::string& partition, const Survey& survey) {
  for (const auto& [id, name] : survey.names)
    if (wire::partition_of(id) == partition) return wire::called(id, name);
  return partition;
}

/// One line for who opens the page.
std::string in_short(const Survey& survey) {
  std::uint64_t answers = 0, certified = 0;
  for (std::size_t i = 0; i < survey.by_status.size(); ++i) {
    answers += survey.by_status[i];
    if (is_certified(static_cast<AnswerStatus>(i))) certified += survey.by_status[i];
  }
  std::uint64_t bytes = 0;
  for (const TopicCount& topic : survey.topics) bytes += topic.bytes;
  return number(survey.duration_s, 4) + " s, " + counted(survey.peers.size(), "peer") + ", " +
         counted(answers, "answer") + ", " + std::to_string(certified) + " of them certified, " +
         number(static_cast<double>(bytes) / 1e6, 3) + " MB";
}

/// What is far from everything may change in the picture some 3,000 times: in a session of 10
/// minutes 5 times a second.
FilmPlan plan_for(double duration_s) {
  return {.least_step_ms = static_cast<std::int64_t>(duration_s / 3)};
}

std::string head_of(const std::string& title, const PlayerPage& player) {
  return std::string(kPageFile.begins) +
         "<meta name=\"viewport\" content=\"width=device-width\">"
         "<link rel=\"icon\" href=\"data:,\"><title>" +
         title + "</title><style>" + kStyle + player.style + "</style></head><body>\n<header><h1>" +
         title + "</h1>";
}

}  // namespace

Result<std::string> live_page(const std::string& title) {
  const Result<PlayerPage> player = player_page(nullptr, {});
  NEARMESH_RETURN_IF_ERROR(player);
  return head_of(escape(title), player.value()) +
         "<p data-live=\"state\">waiting for peers</p></header>\n" +
         (player.value().body.empty() ? "<p class=\"none\">" + std::string(kNoPlayer) + ".</p>"
                                      : player.value().body) +
         "<main><section id=\"processes\"><h2>Processes</h2><div class=\"scroll\">"
         "<table data-live=\"processes\"></table></div></section></main></body></html>\n";
}

Result<std::string> html_page(RecordingReader& recording, const std::string& title) {
  const Result<Survey> counts = survey(recording);
  NEARMESH_RETURN_IF_ERROR(counts);
  const Result<History> gathered = gather_history(recording);
  NEARMESH_RETURN_IF_ERROR(gathered);
  const History& history = gathered.value();
  std::map<std::string, std::string> names;
  for (const auto& [id, called] : counts.value().names) names[wire::partition_of(id)] = called;
  PlayerPage player;
  if (!player_files().three.empty()) {
    const Result<Film> film = make_film(recording, plan_for(history.duration_s));
    NEARMESH_RETURN_IF_ERROR(film);
    Result<PlayerPage> made = player_page(&film.value(), names);
    NEARMESH_RETURN_IF_ERROR(made);
    player = std::move(made).value();
  }
  std::string out = head_of("Session " + escape(title), player) + "<p>" + in_short(counts.value()) +
                    "</p></header>\n";
  out +=
      player.body.empty() ? "<p class=\"none\">" + std::string(kNoPlayer) + ".</p>" : player.body;
  out += "<main>" + summary_section(recording, counts.value());
  std::string charts = certified_figure(history) + accuracy_figure(history);
  if (!charts.empty())
    out +=
        "<section id=\"accuracy\"><h2>Speed and accuracy</h2><p>A recording has no milliseconds of "
        "computing; how fast answers became certain follows from when they arrived.</p>" +
        charts + "</section>\n";
  if (charts = contacts_figure(history); !charts.empty())
    out += "<section id=\"contacts\"><h2>Contacts</h2>" + charts + "</section>\n";
  charts.clear();
  for (const auto& [peer, one] : history.peers)
    charts += timeline_figure(with_name(peer, counts.value()), one, history);
  if (!charts.empty())
    out += "<section id=\"timeline\"><h2>Peers over time</h2>" + charts + "</section>\n";
  return out +
         "<p class=\"dim\">Times are those of the recorder, from the first message. Bars and dots "
         "say "
         "more when pointed at; each chart has its numbers below it.</p></main></body></html>\n";
}

}  // namespace nearmesh::subscriber::report
