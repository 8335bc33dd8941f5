// SPDX-License-Identifier: Apache-2.0
// Grids in PNG files (ISO/IEC 15948:2004): grey or colour samples of 8 or 16 bits. Only zlib is
// needed beside; libraries of images would turn samples into shades, by palette or gamma.
#include <zlib.h>

#include <algorithm>
#include <cstdlib>
#include <optional>
#include <string>
#include <vector>

#include "grid_formats.hpp"
#include "text.hpp"

namespace nearmesh::meshio {
namespace {

Status corrupt_png(std::string message) {
  return {StatusCode::kCorrupt, "PNG: " + std::move(message)};
}

std::uint32_t read_u32(std::string_view bytes) {
  std::uint32_t value = 0;
  for (std::size_t k = 0; k < 4; ++k) value = value << 8 | static_cast<unsigned char>(bytes[k]);
  return value;
}

struct PngChunk {
  std::string_view type, content;
};

/// Takes the next chunk off the front, once its checksum is found right.
Result<PngChunk> take_chunk(std::string_view& bytes) {
  constexpr std::size_t kAround = 12;  // length, type, checksum
  if (bytes.size() < kAround || read_u32(bytes) > bytes.size() - kAround)
    return corrupt_png("expected a whole chunk, found the end of the file");
  const std::size_t size = read_u32(bytes);
  const PngChunk chunk{bytes.substr(4, 4), bytes.substr(8, size)};
  const auto* checked = reinterpret_cast<const Bytef*>(bytes.data() + 4);
  if (crc32_z(0, checked, size + 4) != read_u32(bytes.substr(8 + size)))
    return corrupt_png("chunk " + quote(chunk.type) + ": its checksum is wrong");
  bytes.remove_prefix(size + kAround);
  return chunk;
}

struct PngHeader {
  std::uint32_t columns = 0, rows = 0;
  bool is_colour = false;
  std::uint8_t sample_bytes = 1;
  [[nodiscard]] std::size_t post_bytes() const { return (is_colour ? 3U : 1U) * sample_bytes; }
};

Result<PngHeader> read_header(const PngChunk& chunk) {
  if (chunk.type != "IHDR" || chunk.content.size() != 13)
    return corrupt_png("expected the chunk IHDR of 13 bytes first, found " + quote(chunk.type));
  const auto depth = static_cast<unsigned char>(chunk.content[8]),
             colour = static_cast<unsigned char>(chunk.content[9]),
             interlaced = static_cast<unsigned char>(chunk.content[12]);
  if ((depth != 8 && depth != 16) || (colour != 0 && !(colour == 2 && depth == 8)))
    return Status(StatusCode::kUnsupported,
                  "PNG: expected grey samples of 8 or 16 bits, or red, green and blue of 8, "
                  "without alpha or palette; found colour type " +
                      std::to_string(colour) + " of " + std::to_string(depth) + " bits");
  if (interlaced != 0)
    return Status(StatusCode::kUnsupported, "PNG: expected rows in order, found an interlaced one");
  return PngHeader{read_u32(chunk.content), read_u32(chunk.content.substr(4)), colour == 2,
                   static_cast<std::uint8_t>(depth / 8)};
}

/// The sample that is to be seen through: who wrote it meant that nothing is there. It takes two
/// bytes for grey, and for each colour, also where samples have one.
Result<double> read_transparent(std::string_view content, const PngHeader& header) {
  const std::size_t colours = header.is_colour ? 3 : 1;
  if (content.size() != 2 * colours)
    return corrupt_png("chunk \"tRNS\": expected " + std::to_string(2 * colours) +
                       " bytes, found " + std::to_string(content.size()));
  std::string sample;
  for (std::size_t k = 0; k < colours; ++k)
    sample += content.substr(2 * k + 2 - header.sample_bytes, header.sample_bytes);
  return decode_sample(sample, {.kind = RawGrid::Kind::kUnsigned,
                                .sample_bytes = static_cast<std::uint8_t>(sample.size()),
                                .is_big_endian = true});
}

/// The chunks IDAT are one zlib stream, cut anywhere.
class Inflater {
 public:
  explicit Inflater(std::vector<std::string_view> pieces) : pieces_(std::move(pieces)) {
    is_good_ = inflateInit(&stream_) == Z_OK;
  }
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;
  ~Inflater() { inflateEnd(&stream_); }

  /// Whether there were so many bytes left.
  bool read(std::vector<std::uint8_t>& out) {
    stream_.next_out = out.data();
    stream_.avail_out = static_cast<uInt>(out.size());
    while (is_good_ && stream_.avail_out > 0) {
      if (stream_.avail_in == 0 && next_ < pieces_.size()) {
        const std::string_view piece = pieces_[next_++];
        // zlib's interface lacks a const.
        stream_.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(piece.data()));
        stream_.avail_in = static_cast<uInt>(piece.size());  // a chunk is below 2^32 bytes
        continue;
      }
      is_good_ = inflate(&stream_, Z_NO_FLUSH) == Z_OK || stream_.avail_out == 0;
    }
    return stream_.avail_out == 0;
  }

 private:
  std::vector<std::string_view> pieces_;
  std::size_t next_ = 0;
  z_stream stream_{};
  bool is_good_ = false;
};

int paeth(int left, int above, int corner) {
  const int guess = left + above - corner;
  const int a = std::abs(guess - left), b = std::abs(guess - above), c = std::abs(guess - corner);
  return a <= b && a <= c ? left : b <= c ? above : corner;
}

/// Undoes what was taken off a row, whose first byte says what that was. False: no such filter.
bool unfilter(std::vector<std::uint8_t>& row, const std::vector<std::uint8_t>& above,
              std::size_t post_bytes) {
  const std::uint8_t filter = row[0];
  if (filter > 4) return false;
  for (std::size_t i = 1; i < row.size(); ++i) {
    const bool is_first = i <= post_bytes;
    const int left = is_first ? 0 : row[i - post_bytes], up = above[i],
              corner = is_first ? 0 : above[i - post_bytes];
    const int guess = filter == 1   ? left
                      : filter == 2 ? up
                      : filter == 3 ? (left + up) / 2
                      : filter == 4 ? paeth(left, up, corner)
                                    : 0;
    row[i] = static_cast<std::uint8_t>(row[i] + guess);
  }
  return true;
}

}  // namespace

Result<HeightGrid> read_png(std::string_view bytes) {
  constexpr std::string_view kSignature = "\x89PNG\r\n\x1a\n";
  if (!bytes.starts_with(kSignature))
    return corrupt_png("expected its signature, found " +
                       quote(bytes.substr(0, kSignature.size())));
  bytes.remove_prefix(kSignature.size());
  const auto first = take_chunk(bytes);
  NEARMESH_RETURN_IF_ERROR(first);
  const auto read = read_header(first.value());
  NEARMESH_RETURN_IF_ERROR(read);
  const PngHeader& header = read.value();
  std::vector<std::string_view> pieces;
  std::uint64_t packed = 0;
  std::optional<double> transparent;
  for (;;) {
    const auto chunk = take_chunk(bytes);
    NEARMESH_RETURN_IF_ERROR(chunk);
    const auto& [type, content] = chunk.value();
    if (type == "IEND") break;
    if (type == "IDAT") {
      packed += content.size();
      pieces.push_back(content);
    } else if (type == "tRNS") {
      const auto sample = read_transparent(content, header);
      NEARMESH_RETURN_IF_ERROR(sample);
      transparent = sample.value();
    } else if (type.front() >= 'A' && type.front() <= 'Z' && type != "PLTE") {
      return Status(StatusCode::kUnsupported, "PNG: unknown chunk " + quote(type));
    }
  }
  // Deflate packs 1,032 bytes into one at best.
  NEARMESH_RETURN_IF_ERROR(check_grid_size("PNG", header.columns, header.rows, packed,
                                           1032.0 / static_cast<double>(header.post_bytes())));
  HeightGrid grid{.columns = header.columns, .rows = header.rows};
  grid.needs_heights = header.is_colour;
  grid.nodata = transparent;
  const RawGrid sample{.kind = RawGrid::Kind::kUnsigned,
                       .sample_bytes = static_cast<std::uint8_t>(header.post_bytes()),
                       .is_big_endian = true};
  grid.samples.reserve(grid.columns * grid.rows);
  Inflater inflater(std::move(pieces));
  std::vector<std::uint8_t> row(1 + grid.columns * header.post_bytes()), above(row.size());
  for (std::uint64_t r = 0; r < grid.rows; ++r) {
    if (!inflater.read(row))
      return corrupt_png("row " + std::to_string(r) + ": expected " + std::to_string(grid.rows) +
                         " rows, its samples end or cannot be unpacked here");
    if (!unfilter(row, above, header.post_bytes()))
      return corrupt_png("row " + std::to_string(r) + ": expected a filter from 0 to 4, found " +
                         std::to_string(row[0]));
    const std::string_view samples(reinterpret_cast<const char*>(row.data()) + 1, row.size() - 1);
    for (std::size_t at = 0; at < samples.size(); at += header.post_bytes())
      grid.samples.push_back(decode_sample(samples.substr(at), sample));
    row.swap(above);
  }
  return grid;
}

}  // namespace nearmesh::meshio
