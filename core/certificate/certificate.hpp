// SPDX-License-Identifier: Apache-2.0
#pragma once
// The cheapest detail that lets a peer certify its answers: who serves both models runs the peer's
// own query on a mirror of what the peer holds, and splits what stands in the way, now and ahead.
// Takes poses and mirrors, gives batches. The peer proves every answer itself; a wrong choice here
// costs a round trip.

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/certificate/mirror.hpp"
#include "core/certificate/spare_splits.hpp"
#include "core/query/lacking_ahead.hpp"
#include "nearmesh/core/geometry/motion.hpp"
#include "nearmesh/core/spm/detail/certificate_request.hpp"
#include "nearmesh/core/spm/detail/codec.hpp"

namespace nearmesh {

/// How body b moves as seen from body a, rounded as a request is.
[[nodiscard]] CertificateRequest::Pair relative(const Motion& a, const Motion& b);

/// Makes the batches, a little at a time, so that who serves many is never held up by one.
/// Threads: one at a time.
class CertificateMaker {
 public:
  /// So many splits at most are sent for one request, and those that they rest on, and so many
  /// tests made, some tenths of a second; the peer asks on.
  static constexpr std::size_t kMaxSplits = 32'768;
  static constexpr std::uint64_t kMaxTests = 10'000'000;

  /// `mirrors`: of the request's models, in their order.
  /// In: a request that check_request() accepted.
  CertificateMaker(CertificateRequest request, std::vector<std::shared_ptr<Mirror>> mirrors);

  struct Part {
    std::size_t model = 0;  ///< of the request's, which the batches are of; its content:
    ContentHash content;
    std::vector<std::vector<std::uint8_t>> batches;
  };
  /// One round of a query, or the batches of one model; perhaps none yet. Errors: those of reading
  /// the files, and of the request's poses; nothing follows then.
  /// `round_tests`: so many tests a look or a query takes; less makes rounds shorter, and more of
  /// them. A query that finds nothing within them is asked again with four times as many.
  [[nodiscard]] Result<Part> next(std::uint64_t round_tests = kLookTests);
  [[nodiscard]] bool is_done() const { return step_ == Step::kDone; }
  /// next() gives batches, which share samples with those of the models before (SampleRoom).
  [[nodiscard]] bool is_sending() const { return step_ == Step::kSend; }
  /// What was done so far, in tests: a split takes as long as ten.
  [[nodiscard]] std::uint64_t work() const { return tests_ + 10 * split_count_; }
  /// After an error: the content whose file could not be read, if that was it. The peer is to ask
  /// for regions of that one alone.
  [[nodiscard]] const std::optional<ContentHash>& unreadable() const { return unreadable_; }

 private:
  enum class Step : std::uint8_t { kNow, kAhead, kSpare, kSend, kDone };
  [[nodiscard]] Status note_read(std::size_t model, const Status& read);
  [[nodiscard]] Status round(std::uint64_t round_tests);
  [[nodiscard]] Status spare(std::uint64_t round_tests);
  [[nodiscard]] double margin_m(const CertificateRequest::Pair& pair, bool is_ahead) const;
  [[nodiscard]] Status split(const CertificateRequest::Pair& pair, std::span<const NodeSpan> a,
                             std::span<const NodeSpan> b);
  [[nodiscard]] std::size_t beside_last() const;
  Part encode(std::size_t model);

  CertificateRequest request_;
  std::vector<std::shared_ptr<Mirror>> mirrors_;
  // By model: what is to be sent; nodes that have to be split, since a ray or half-spaces of theirs
  // did not settle them.
  std::vector<std::vector<VertexId>> splits_;
  std::vector<std::vector<NodeSpan>> told_of_, kept_;
  std::size_t split_count_ = 0;
  std::uint64_t tests_ = 0;
  std::uint64_t query_tests_ = 0;                  // that the query of a pair may take, at least
  Step step_ = Step::kNow, after_ = Step::kAhead;  // what follows when all that is due was sent
  Step farthest_ = Step::kNow;                     // of what is to be sent next
  bool is_spared_ = false;                         // of that it has been seen what to spare
  std::vector<std::size_t> spare_order_;           // of models
  std::optional<SplitSparer> sparer_;
  std::optional<ContentHash> unreadable_;
  SampleRoom room_;     // of what is sent
  std::size_t at_ = 0;  // the pair, or the model that is sent
};

/// A request that a server has begun to answer, or why it does not.
struct BegunCertificate {
  std::optional<CertificateMaker> maker;
  std::string why_not;
  ContentHash content;         ///< of which it is not; or none: of all
  bool wants_regions = false;  ///< the peer is to ask for regions of it; else to say what it holds
};

/// Finds the mirrors for a request, and makes those that sleep, or are not there, of what they were
/// or what the peer says that it holds, in parts.
/// Threads: one at a time.
class CertificateBeginner {
 public:
  /// The file of a content that is served here; else nullptr.
  using FileOf = std::function<std::shared_ptr<ModelFile>(const ContentHash&)>;
  /// In: a request that check_request() accepted. The mirrors must outlive it.
  CertificateBeginner(std::uint64_t peer, CertificateRequest request, Mirrors& mirrors,
                      FileOf file_of);

  /// Looks for one file at most, since a tile that has to be opened takes as long as a turn, and
  /// does so many of the nodes that are told (MirrorMaker::next()). Out: none while there are more.
  [[nodiscard]] std::optional<BegunCertificate> next(std::size_t nodes);
  /// So many were looked at, true or not.
  [[nodiscard]] std::size_t told_nodes() const { return told_nodes_; }
  /// A mirror is half made.
  [[nodiscard]] bool is_making() const { return maker_ != nullptr; }

 private:
  [[nodiscard]] BegunCertificate begin();
  [[nodiscard]] std::optional<BegunCertificate> look_for_any();

  std::uint64_t peer_;
  CertificateRequest request_;
  Mirrors* mirrors_;
  FileOf file_of_;
  std::vector<std::shared_ptr<Mirror>> found_;  // of the request's models, in their order
  std::unique_ptr<MirrorMaker> maker_;          // of the one after these
  bool is_waking_ = false;                      // it makes what slept
  std::size_t not_served_ = 0;                  // so many of the first are not, and none is found
  std::size_t told_nodes_ = 0;
};

/// The same at once.
[[nodiscard]] BegunCertificate begin_certificate(std::uint64_t peer,
                                                 const CertificateRequest& request,
                                                 Mirrors& mirrors,
                                                 const CertificateBeginner::FileOf& file_of);

}  // namespace nearmesh
