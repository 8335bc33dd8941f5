// SPDX-License-Identifier: Apache-2.0
#pragma once
// What all peers of a film share (takes headers and poses, gives numbers of models and bodies). For
// film.cpp alone.

#include <algorithm>
#include <cstdint>
#include <map>
#include <memory>
#include <string>

#include "film_model.hpp"
#include "film_stream.hpp"
#include "nearmesh/core/recording/recording.hpp"

namespace nearmesh::subscriber {

/// Of a body whose model is unknown: 2^-12 m, a quarter of a millimetre.
inline constexpr int kBodyUnit = -12;

/// What all peers share: the numbers of models and bodies.
class FilmWorld {
 public:
  FilmWorld() = default;
  FilmWorld(const FilmWorld&) = delete;
  FilmWorld& operator=(const FilmWorld&) = delete;

  /// What is known of the recording as a whole.
  void look(const RecordingReader& recording) {
    begin_ns_ = recording.begin_ns();
    for (const RecordedModel& model : recording.models()) names_[model.content_hash] = model.name;
  }

  [[nodiscard]] std::int64_t ms_of(std::int64_t received_ns) const {
    return std::max<std::int64_t>(0, (received_ns - begin_ns_) / 1'000'000);
  }
  struct KnownModel {
    std::uint32_t number = 0;
    int unit = 0;
    std::unique_ptr<FilmModel> model;
  };
  KnownModel& model_of(const ContentHash& content, const SpmHeader& header) {
    KnownModel& known = models_[content];
    if (known.model) return known;
    known.number = static_cast<std::uint32_t>(models_.size() - 1);
    known.unit = header.grid.exponent + 4;
    known.model = std::make_unique<FilmModel>(models, known.number);
    models.begin('M', known.number, header.face_count);
    models.text(names_[content]);
    models.text(to_hex(content));
    models.signed_number(header.grid.exponent);
    for (const double origin : header.grid.origin_m) models.real(origin);
    return known;
  }
  [[nodiscard]] const KnownModel* known_model(const ContentHash& content) const {
    const auto at = models_.find(content);
    return at == models_.end() || !at->second.model ? nullptr : &at->second;
  }
  /// `model`: none where only a pose was heard.
  std::uint32_t body_of(const std::string& name, const KnownModel* model) {
    const auto [at, is_new] = bodies_.try_emplace(name, bodies_.size());
    Body& body = at->second;
    const std::int64_t now = model == nullptr ? -1 : std::int64_t{model->number};
    if (is_new || (now >= 0 && now != body.model)) {
      if (now >= 0) body.model = now;
      body.unit = model == nullptr ? kBodyUnit : model->unit;
      body.way = {};
      world.begin('B', body.number, static_cast<std::uint64_t>(body.model + 1));
      world.signed_number(body.unit);
      world.text(name);
    }
    return body.number;
  }
  [[nodiscard]] int unit_of(const std::string& name) const { return bodies_.at(name).unit; }
  void take(const std::string& name, const Pose& pose, std::int64_t ms) {
    const std::uint32_t number = body_of(name, nullptr);
    Body& body = bodies_.at(name);
    FilmPose told(pose, body.unit);
    if (body.way.is_at(told)) return;
    ms = std::max(ms, last_ms_);  // the recorder's clock may have gone back
    world.begin('P', number, static_cast<std::uint64_t>(ms - last_ms_));
    last_ms_ = ms;
    body.way.tell(told, world);
  }

  FilmStream models, world;

 private:
  struct Body {
    explicit Body(std::size_t count) : number(static_cast<std::uint32_t>(count)) {}
    std::uint32_t number;
    std::int64_t model = -1;
    int unit = kBodyUnit;
    FilmWay way{};
  };
  std::int64_t begin_ns_ = 0;
  std::map<ContentHash, std::string> names_;
  std::map<ContentHash, KnownModel> models_;
  std::map<std::string, Body> bodies_;
  std::int64_t last_ms_ = 0;
};

}  // namespace nearmesh::subscriber
