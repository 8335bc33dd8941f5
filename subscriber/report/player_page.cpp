// SPDX-License-Identifier: Apache-2.0
#include "player_page.hpp"

#include <zlib.h>

#include <nlohmann/json.hpp>

namespace nearmesh::subscriber::report {
namespace {

std::string base64(std::string_view bytes) {
  constexpr const char* kDigits =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k)
      group = group << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      out += i + k > bytes.size() ? '=' : kDigits[group >> (18 - 6 * k) & 63];
  }
  return out;
}

/// A stream as an element that the script reads when it needs it.
Status add_stream(const std::string& name, const std::string& bytes, std::string& out) {
  uLongf size = compressBound(static_cast<uLong>(bytes.size()));
  std::string packed(size, '\0');
  if (compress2(reinterpret_cast<Bytef*>(packed.data()), &size,
                reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uLong>(bytes.size()),
                Z_BEST_COMPRESSION) != Z_OK)
    return {StatusCode::kIo, "no memory to compress the moving picture"};
  packed.resize(size);
  out += "<script type=\"text/plain\" id=\"film-" + name + "\">" + base64(packed) + "</script>\n";
  return Status::ok();
}

}  // namespace

Result<PlayerPage> player_page(const Film* film, const std::map<std::string, std::string>& names) {
  const PlayerFiles& files = player_files();
  if (files.three.empty()) return PlayerPage{};
  PlayerPage page{.style = std::string(files.style), .body = std::string(files.markup)};
  nlohmann::json facts{{"peers", nlohmann::json::array()},
                       {"names", nlohmann::json::object()},
                       {"live", film == nullptr}};
  if (film != nullptr) {
    for (const Film::Stream& stream : film->streams)
      NEARMESH_RETURN_IF_ERROR(add_stream(stream.name, stream.bytes, page.body));
    facts["peers"] = film->peers;
    for (const std::string& id : film->peers)
      if (const auto name = names.find(id); name != names.end()) facts["names"][id] = name->second;
  }
  // A "<" in a name could end the element.
  std::string told = facts.dump(-1, ' ', true, nlohmann::json::error_handler_t::replace);
  for (std::size_t at = told.find('<'); at != std::string::npos; at = told.find('<', at))
    told.replace(at, 1, "\\u003c");
  page.body += "<script type=\"application/json\" id=\"film-facts\">" + told + "</script>\n";
  page.body += "<script>/*\n" + std::string(files.three_licence) + "*/\n" +
               std::string(files.three) + "</script>\n<script>" + std::string(files.script) +
               "</script>\n";
  return page;
}

}  // namespace nearmesh::subscriber::report
