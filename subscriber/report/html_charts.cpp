// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <cmath>
#include <cstdio>

#include "html_parts.hpp"
#include "nearmesh/core/query/query.hpp"

namespace nearmesh::subscriber::report {
namespace {

// Of every chart, in units of its viewBox.
constexpr double kWidth = 860, kLeft = 62, kRight = 12;
constexpr double kPlot = kWidth - kLeft - kRight;
constexpr std::size_t kMostPoints = 2000;  ///< of a scatter chart
constexpr std::size_t kSeriesColours = 8;  ///< classes .p0 to .p7

/// The next of 1, 2, 5, 10, 20, ... (and 0.5, 0.2, ...) that is at least x > 0.
double round_step(double x) {
  double power = 1;
  while (power > x) power /= 10;
  while (power * 10 <= x) power *= 10;
  for (const double factor : {1, 2, 5})
    if (factor * power >= x) return factor * power;
  return 10 * power;
}

/// The panel of a chart: axes from 0, with ticks.
class Panel {
 public:
  Panel(std::string& out, double top, double height, double x_most, double y_most)
      : out_(out), top_(top), height_(height), x_most_(x_most > 0 ? x_most : 1) {
    y_step_ = round_step((y_most > 0 ? y_most : 1) / 3);
    y_most_ = y_step_ * std::ceil((y_most > 0 ? y_most : 1) / y_step_ * (1 - 1e-9));
  }
  [[nodiscard]] double x(double value) const { return kLeft + kPlot * value / x_most_; }
  [[nodiscard]] double y(double value) const { return top_ + height_ * (1 - value / y_most_); }
  void axes(const std::string& x_title, const std::string& y_title) {
    for (double value = 0; value <= y_most_ * (1 + 1e-9); value += y_step_) {
      line(kLeft, y(value), kWidth - kRight, y(value), value == 0 ? "axis" : "grid");
      text(kLeft - 6, y(value) + 4, "end", number(value));
    }
    text(2, top_ - 14, "start", y_title);
    if (x_title.empty()) return;
    const double step = round_step(x_most_ / 8);
    for (double value = 0; value <= x_most_ * (1 + 1e-9); value += step) {
      line(x(value), top_ + height_, x(value), top_ + height_ + 4, "axis");
      text(x(value), top_ + height_ + 17, "middle", number(value));
    }
    text(kWidth - kRight, top_ + height_ + 32, "end", x_title);
  }
  void bar(double from, double to, double low, double high, const std::string& css,
           const std::string& tip) {
    out_ += "<rect class=\"" + css + "\" x=\"" + number(x(from), 5) + "\" y=\"" +
            number(y(high), 5) + "\" width=\"" + number(std::max(0.5, x(to) - x(from) - 0.6), 4) +
            "\" height=\"" + number(y(low) - y(high), 5) + "\"><title>" + escape(tip) +
            "</title></rect>";
  }
  void dot(double at_x, double at_y, const std::string& css) {
    out_ += "<circle class=\"" + css + "\" cx=\"" + number(x(at_x), 5) + "\" cy=\"" +
            number(y(at_y), 5) + "\" r=\"3.5\"/>";
  }
  /// A value stays until the next.
  void steps(const std::vector<std::array<double, 2>>& points, const std::string& css) {
    out_ += "<polyline class=\"" + css + "\" points=\"";
    double last = 0;
    for (const auto& [px, py] : points) {
      if (&px != points.front().data()) out_ += number(x(px), 5) + "," + number(y(last), 5) + " ";
      out_ += number(x(px), 5) + "," + number(y(py), 5) + " ";
      last = py;
    }
    out_ += "\"/>";
  }

 private:
  void line(double x1, double y1, double x2, double y2, const char* css) {
    out_ += std::string("<line class=\"") + css + "\" x1=\"" + number(x1, 5) + "\" y1=\"" +
            number(y1, 5) + "\" x2=\"" + number(x2, 5) + "\" y2=\"" + number(y2, 5) + "\"/>";
  }
  void text(double at_x, double at_y, const char* anchor, const std::string& what) {
    out_ += "<text x=\"" + number(at_x, 5) + "\" y=\"" + number(at_y, 5) + "\" text-anchor=\"" +
            anchor + "\">" + escape(what) + "</text>";
  }

  std::string& out_;
  double top_, height_, x_most_, y_most_ = 1, y_step_ = 1;
};

std::string figure(const std::string& title, const std::string& description, double height,
                   const std::string& drawing, const std::string& caption,
                   const std::string& table) {
  return "<figure><svg role=\"img\" viewBox=\"0 0 " + number(kWidth) + " " + number(height) +
         "\" aria-label=\"" + escape(title + ". " + description) + "\"><title>" + escape(title) +
         "</title><desc>" + escape(description) + "</desc>" + drawing + "</svg><figcaption>" +
         caption + "</figcaption><details><summary>Numbers</summary><div class=\"scroll\">" +
         table + "</div></details></figure>\n";
}

std::string row(const std::vector<std::string>& cells, const char* tag = "td") {
  std::string out = "<tr>";
  for (const std::string& cell : cells)
    out += std::string("<") + tag + ">" + cell + "</" + tag + ">";
  return out + "</tr>";
}

std::string legend(const std::vector<std::pair<std::string, std::string>>& entries) {
  std::string out = "<ul class=\"legend\">";
  for (const auto& [css, name] : entries)
    out += "<li><svg class=\"swatch\" viewBox=\"0 0 12 12\" aria-hidden=\"true\"><rect class=\"" +
           css + "\" width=\"12\" height=\"12\"/></svg> " + escape(name) + "</li>";
  return out + "</ul>";
}

std::string series(std::size_t i, const char* kind) {
  return std::string(kind) + " p" + std::to_string(i % kSeriesColours);
}

std::string peer_legend(const History& history) {
  std::vector<std::pair<std::string, std::string>> entries;
  for (const auto& [peer, unused] : history.peers)
    entries.emplace_back(series(entries.size(), "fill"), "peer " + peer);
  return legend(entries);
}

}  // namespace

std::string escape(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto c = static_cast<unsigned char>(text[i]);
    const std::size_t more = c < 0x80                ? 0
                             : c >= 0xc2 && c < 0xe0 ? 1
                             : c >= 0xe0 && c < 0xf0 ? 2
                             : c >= 0xf0 && c < 0xf5 ? 3
                                                     : 4;
    bool good = c >= 0x20 && c != 0x7f && more < 4 && i + more < text.size();
    for (std::size_t k = 1; good && k <= more; ++k)
      good = (static_cast<unsigned char>(text[i + k]) & 0xc0) == 0x80;
    if (!good)
      out += '?';
    else if (c == '&')
      out += "&amp;";
    else if (c == '<')
      out += "&lt;";
    else if (c == '>')
      out += "&gt;";
    else if (c == '"')
      out += "&quot;";
    else
      out += text.substr(i, 1 + more);
    if (good) i += more;
  }
  return out;
}

std::string number(double x, int digits) {
  char text[32];
  std::snprintf(text, sizeof text, "%.*g", digits, x);
  if (std::string_view(text).find('e') != std::string_view::npos && std::abs(x) >= 1)
    std::snprintf(text, sizeof text, "%.0f", x);
  return text;
}

std::string timeline_figure(const std::string& peer, const PeerHistory& one,
                            const History& history) {
  PeerHistory::Bin sum;
  std::uint64_t most_answers = 0, most_bytes = 0;
  for (const PeerHistory::Bin& bin : one.bins) {
    std::uint64_t answers = 0;
    for (std::size_t s = 0; s < kStatuses; ++s) {
      answers += bin.answers[s];
      sum.answers[s] += bin.answers[s];
    }
    sum.bytes += bin.bytes;
    most_answers = std::max(most_answers, answers);
    most_bytes = std::max(most_bytes, bin.bytes);
  }
  if (most_answers == 0 && most_bytes == 0) return "";
  constexpr double kHeight = 334;
  const double width_s = history.bin_s, span_s = width_s * static_cast<double>(history.bins);
  std::string drawing;
  Panel answers(drawing, 30, 150, span_s, static_cast<double>(most_answers));
  Panel bytes(drawing, 224, 70, span_s, static_cast<double>(most_bytes));
  answers.axes("", "answers in " + number(width_s, 3) + " s");
  bytes.axes("seconds", "bytes of batches in " + number(width_s, 3) + " s");
  std::string table = "<table><caption>Totals</caption>";
  std::vector<std::string> heads, totals;
  for (std::size_t s = 0; s < kStatuses; ++s) {
    heads.emplace_back(to_string(static_cast<AnswerStatus>(s)));
    totals.push_back(std::to_string(sum.answers[s]));
  }
  heads.emplace_back("bytes");
  totals.push_back(std::to_string(sum.bytes));
  table += row(heads, "th") + row(totals) + "</table>";
  for (std::size_t i = 0; i < history.bins; ++i) {
    const PeerHistory::Bin& bin = one.bins[i];
    const double from = static_cast<double>(i) * width_s, to = from + width_s;
    double low = 0;
    for (const std::size_t s : {0U, 4U, 1U, 2U, 3U}) {  // certified ones below
      if (bin.answers[s] == 0) continue;
      const double high = low + static_cast<double>(bin.answers[s]);
      answers.bar(from, to, low, high, "s" + std::to_string(s),
                  number(from) + " s: " + std::to_string(bin.answers[s]) + " " +
                      to_string(static_cast<AnswerStatus>(s)));
      low = high;
    }
    if (bin.bytes > 0)
      bytes.bar(from, to, 0, static_cast<double>(bin.bytes), "bytes",
                number(from) + " s: " + std::to_string(bin.bytes) + " bytes");
  }
  std::string description = "Answers over time, stacked by status, and bytes received. In total";
  std::vector<std::pair<std::string, std::string>> entries;
  for (const std::size_t s : {0U, 4U, 1U, 2U, 3U}) {
    const std::string status = to_string(static_cast<AnswerStatus>(s));
    description += " " + std::to_string(sum.answers[s]) + " " + status + ",";
    if (sum.answers[s] > 0) entries.emplace_back("s" + std::to_string(s), status);
  }
  description += " " + std::to_string(sum.bytes) + " bytes.";
  return figure("Peer " + peer, description, kHeight, drawing,
                "Peer <code>" + escape(peer) + "</code>: " + std::to_string(sum.bytes) +
                    " bytes of batches." + legend(entries),
                table);
}

std::string contacts_figure(const History& history) {
  if (history.contacts.empty()) return "";
  std::uint32_t most = 0;
  for (const auto& [body, bins] : history.contacts)
    most = std::max(most, *std::max_element(bins.begin(), bins.end()));
  constexpr double kEach = 118;
  const double width_s = history.bin_s, span_s = width_s * static_cast<double>(history.bins);
  std::string drawing, table = "<table><caption>Most touching face pairs</caption>" +
                               row({"body", "face pairs", "parts of the session in contact"}, "th");
  double top = 30;
  for (const auto& [body, bins] : history.contacts) {
    const bool is_last = body == history.contacts.rbegin()->first;
    Panel panel(drawing, top, kEach - 48, span_s, most);
    panel.axes(is_last ? "seconds" : "", body);
    std::size_t touching = 0;
    for (std::size_t i = 0; i < history.bins; ++i) {
      if (bins[i] == 0) continue;
      ++touching;
      const double from = static_cast<double>(i) * width_s;
      panel.bar(from, from + width_s, 0, bins[i], "s1",
                number(from) + " s: " + std::to_string(bins[i]) + " face pairs");
    }
    table += row({escape(body), std::to_string(*std::max_element(bins.begin(), bins.end())),
                  std::to_string(touching) + " of " + std::to_string(history.bins)});
    top += kEach;
  }
  return figure("Contacts of each body",
                "Over time, the most touching face pairs of any answer about each of " +
                    std::to_string(history.contacts.size()) + " bodies; at most " +
                    std::to_string(most) + ".",
                top + 14, drawing,
                "The most touching face pairs that any answer about the body had, in each " +
                    number(width_s, 3) + " s.",
                table + "</table>");
}

std::string certified_figure(const History& history) {
  double most_s = 0, most_bytes = 0;
  std::size_t count = 0;
  for (const auto& [peer, one] : history.peers)
    for (const PeerHistory::Certified& time : one.certified) {
      most_s = std::max(most_s, time.seconds);
      most_bytes = std::max(most_bytes, static_cast<double>(time.bytes));
      ++count;
    }
  if (count == 0) return "";
  std::string drawing,
      table = "<table><caption>Seconds to certified</caption>" +
              row({"peer", "times", "min", "median", "max", "bytes, median"}, "th");
  Panel panel(drawing, 30, 204, most_bytes, most_s);
  panel.axes("bytes of batches received meanwhile", "seconds to certified");
  const std::size_t stride = count / kMostPoints + 1;
  std::size_t peer_index = 0;
  for (const auto& [peer, one] : history.peers) {
    std::vector<double> seconds, bytes;
    for (std::size_t i = 0; i < one.certified.size(); ++i) {
      seconds.push_back(one.certified[i].seconds);
      bytes.push_back(static_cast<double>(one.certified[i].bytes));
      if (i % stride == 0) panel.dot(bytes.back(), seconds.back(), series(peer_index, "fill"));
    }
    std::sort(seconds.begin(), seconds.end());
    std::sort(bytes.begin(), bytes.end());
    if (seconds.empty())
      table += row({escape(peer), "0", "", "", "", ""});
    else
      table += row({escape(peer), std::to_string(seconds.size()), number(seconds.front()),
                    number(seconds[seconds.size() / 2]), number(seconds.back()),
                    number(bytes[bytes.size() / 2])});
    ++peer_index;
  }
  std::string caption =
      "A dot for each time an answer was not certified: how long until the next that was, and what "
      "was received meanwhile.";
  if (stride > 1) caption += " Every " + std::to_string(stride) + "th of each peer is drawn.";
  return figure("Time to certified against bytes",
                std::to_string(count) + " times; the longest took " + number(most_s) + " s.", 280,
                drawing, caption + peer_legend(history), table + "</table>");
}

std::string accuracy_figure(const History& history) {
  double most_bytes = 0;
  std::vector<std::vector<std::array<double, 2>>> curves;
  std::string table = "<table><caption>At the end</caption>" +
                      row({"peer", "answers", "certified, %", "bytes"}, "th");
  for (const auto& [peer, one] : history.peers) {
    std::uint64_t bytes = 0, answers = 0, certified = 0;
    std::vector<std::array<double, 2>>& curve = curves.emplace_back();
    for (const PeerHistory::Bin& bin : one.bins) {
      bytes += bin.bytes;
      for (std::size_t s = 0; s < kStatuses; ++s) {
        answers += bin.answers[s];
        if (is_certified(static_cast<AnswerStatus>(s))) certified += bin.answers[s];
      }
      if (answers > 0)
        curve.push_back({static_cast<double>(bytes),
                         100 * static_cast<double>(certified) / static_cast<double>(answers)});
    }
    most_bytes = std::max(most_bytes, static_cast<double>(bytes));
    table += row({escape(peer), std::to_string(answers),
                  answers == 0 ? "" : number(curve.back()[1]), std::to_string(bytes)});
  }
  if (most_bytes == 0) return "";
  std::string drawing;
  Panel panel(drawing, 30, 204, most_bytes, 100);
  panel.axes("bytes of batches received so far", "% of answers so far that were certified");
  for (std::size_t i = 0; i < curves.size(); ++i) panel.steps(curves[i], series(i, "stroke"));
  return figure("Share certified against bytes received",
                "A curve a peer: of all answers so far, the share that was certified.", 280,
                drawing,
                "Of all answers that a peer had given when so many bytes had come, the share that "
                "was certified." +
                    peer_legend(history),
                table + "</table>");
}

}  // namespace nearmesh::subscriber::report
