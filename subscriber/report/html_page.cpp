// SPDX-License-Identifier: Apache-2.0
#include "html_page.hpp"

#include "core/base/hash.hpp"
#include "html_parts.hpp"
#include "idl/messages/process_name.hpp"
#include "nearmesh/core/query/query.hpp"
#include "nearmesh/idl/messages/topics.hpp"
#include "subscriber/recorded/survey.hpp"

namespace nearmesh::subscriber::report {
namespace {

// Colours of statuses and peers are told apart with any colour vision (Okabe and Ito), on light and on dark.
constexpr const char* kStyle = R"css(
:root{color-scheme:light dark;--back:#fff;--text:#1c2430;--dim:#556070;--line:#c9d0d8;--grid:#e8ecf0;--panel:#f5f7f9;
--free:#009e73;--contact:#d55e00;--partial:#cc79a7;--uncertain:#8a929c;--contained:#56b4e9;--bytes:#0072b2}
@media(prefers-color-scheme:dark){:root{--back:#14181d;--text:#e6eaef;--dim:#a4adb8;--line:#47505b;--grid:#2a313a;
--panel:#1d232a;--bytes:#56a8dc}}
body{margin:0 auto;max-width:62rem;padding:1.5rem;background:var(--back);color:var(--text);
font:16px/1.5 system-ui,sans-serif}
h1{font-size:1.6rem;margin:0 0 .2rem}h2{font-size:1.2rem;margin:2.2rem 0 .6rem;border-bottom:1px solid var(--line)}
p.dim,figcaption{color:var(--dim)}figcaption{font-size:.9rem}
figure{margin:1rem 0 1.6rem}figure>svg{width:100%;height:auto;background:var(--panel);border-radius:6px}
.picture>svg{max-width:52rem}
svg text{font:12px system-ui,sans-serif;fill:var(--dim)}
.axis{stroke:var(--dim)}.grid{stroke:var(--grid)}
.s0{fill:var(--free)}.s1{fill:var(--contact)}.s2{fill:var(--partial)}.s3{fill:var(--uncertain)}.s4{fill:var(--contained)}
.bytes{fill:var(--bytes)}
.p0{--c:#0072b2}.p1{--c:#d55e00}.p2{--c:#009e73}.p3{--c:#cc79a7}.p4{--c:#e69f00}.p5{--c:#56b4e9}.p6{--c:#8a929c}
.p7{--c:#b8a200}
.fill{fill:var(--c);fill-opacity:.75}.stroke{fill:none;stroke:var(--c);stroke-width:2}
.mesh path{fill:currentColor;stroke:currentColor;stroke-width:.6;stroke-linejoin:round}
.mesh path.o{fill:none;stroke:#000;stroke-opacity:.3;stroke-width:.5}
.mesh path.contact{fill:none;stroke:#f0f;stroke-width:2.4;stroke-linecap:round}
table{border-collapse:collapse;font-size:.9rem;font-variant-numeric:tabular-nums}
th,td{padding:.2rem .7rem .2rem 0;text-align:left;border-bottom:1px solid var(--grid)}caption{text-align:left}
.scroll{overflow-x:auto}.legend{list-style:none;display:flex;flex-wrap:wrap;gap:.2rem 1.1rem;margin:.3rem 0;padding:0}
.swatch{width:.8em;height:.8em}
.scale{display:inline-block;width:9rem;height:.9em;vertical-align:-.1em;border-radius:2px;
background:linear-gradient(90deg,#ffffb2,#fecc5c,#fd8d3c,#f03b20,#bd0026)}
.chip{display:inline-block;width:.9em;height:.9em;vertical-align:-.1em;border-radius:2px}
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

/// What is to be pictured: the moments asked for, or those that the history suggests.
Result<std::vector<Moment>> moments_of(RecordingReader& recording, const History& history,
                                       const std::vector<double>& at_s) {
  if (at_s.empty()) return history.moments;
  std::vector<Moment> moments;
  for (const double time_s : at_s) {
    const auto after_ns = static_cast<std::int64_t>(std::min(time_s, 1e8) * 1e9 + 0.5);
    const Result<std::int64_t> report =
        find_report(recording, {.received_ns = recording.begin_ns() + after_ns});
    NEARMESH_RETURN_IF_ERROR(report);
    moments.push_back({"At " + number(time_s, 6) + " s", report.value()});
  }
  return moments;
}

Result<std::string> pictures_section(RecordingReader& recording,
                                     const std::vector<Moment>& moments) {
  std::vector<std::int64_t> reports;
  for (const Moment& moment : moments) reports.push_back(moment.report);
  const auto scenes = rebuild_scenes(recording, reports);
  NEARMESH_RETURN_IF_ERROR(scenes);
  std::string out =
      "<section id=\"pictures\"><h2>Meshes at chosen moments</h2><p>"
      "<span class=\"chip\" style=\"background:#3182bd\"></span> exact "
      "<span class=\"chip\" style=\"background:#969696\"></span> exact, of the other body "
      "<span class=\"scale\" role=\"img\" aria-label=\"yellow to red\"></span> eps, the bound of "
      "the distance to the full mesh, from 1/8192 to 1/8 of the model's size "
      "<span class=\"chip\" style=\"background:#f0f\"></span> contact</p>\n";
  if (moments.empty()) out += "<p>No answer was about meshes that are recorded.</p>";
  for (std::size_t i = 0; i < moments.size(); ++i) {
    const Result<RecordedScene>& scene = scenes.value()[i];
    if (scene.is_ok())
      out += picture_figure(
          scene.value(), moments[i].why,
          static_cast<double>(scene.value().received_ns - recording.begin_ns()) * 1e-9);
    else
      out += "<p>" + escape(moments[i].why + ": no picture, " + scene.status().message()) + "</p>";
  }
  return out + "</section>\n";
}

}  // namespace

Result<std::string> html_page(RecordingReader& recording, const std::string& title,
                              const std::vector<double>& at_s) {
  const Result<Survey> counts = survey(recording);
  NEARMESH_RETURN_IF_ERROR(counts);
  const Result<History> gathered = gather_history(recording);
  NEARMESH_RETURN_IF_ERROR(gathered);
  const History& history = gathered.value();
  const Result<std::vector<Moment>> moments = moments_of(recording, history, at_s);
  NEARMESH_RETURN_IF_ERROR(moments);
  const Result<std::string> pictures = pictures_section(recording, moments.value());
  NEARMESH_RETURN_IF_ERROR(pictures);
  const std::string name = escape(title);
  std::string out = std::string(kPageFile.begins) +
                    "<meta name=\"viewport\" content=\"width=device-width\">"
                    "<link rel=\"icon\" href=\"data:,\"><title>Session " +
                    name + "</title><style>" + kStyle +
                    "</style></head><body><main>\n<h1>Session " + name +
                    "</h1><p class=\"dim\">Times are those of the recorder, from the first "
                    "message. Bars and dots say more when pointed at; each chart has its "
                    "numbers below it.</p>\n";
  out += summary_section(recording, counts.value());
  out += pictures.value();
  out +=
      "<section id=\"accuracy\"><h2>Speed and accuracy</h2><p>A recording has no milliseconds of "
      "computing; how fast answers became certain follows from when they arrived.</p>" +
      certified_figure(history) + accuracy_figure(history) + "</section>\n";
  out += "<section id=\"contacts\"><h2>Contacts</h2>" +
         (history.contacts.empty() ? "<p>No answers.</p>" : contacts_figure(history)) +
         "</section>\n<section id=\"timeline\"><h2>Peers over time</h2>";
  for (const auto& [peer, one] : history.peers)
    out += timeline_figure(with_name(peer, counts.value()), one, history.duration_s);
  return out + "</section>\n</main></body></html>\n";
}

}  // namespace nearmesh::subscriber::report
