// SPDX-License-Identifier: Apache-2.0
#pragma once
// The ways to answer that `nearmesh-model query` compares. Each starts every pose afresh.

#include <memory>
#include <string>

#include "nearmesh/core/query/certify.hpp"
#include "nearmesh/core/query/contacts.hpp"
#include "nearmesh/core/spm/model_file.hpp"

namespace nearmesh::program {

struct QueryMethodOptions {
  QueryOptions query{.any = false, .clearance = Clearance::kNone};
  std::uint32_t global_splits = 16384;
  bool contacts = false;  ///< fill MethodAnswer::contacts
};

/// An answer with what it cost. For full, base and global, whose meshes are the same in every pose,
/// loading, refining and building are counted with the first pose.
struct MethodAnswer {
  Answer answer;
  std::uint64_t splits = 0, slots = 0;  ///< held, both models
  std::uint64_t bytes = 0;  ///< batches on the wire with their framing, both models; no headers
  double refine_s = 0, tree_s = 0, query_s = 0, load_s = 0;
  Contacts contacts;  ///< of the meshes that the method tested; flagged where those are not exact
  double contacts_s = 0;
};

class QueryMethod {
 public:
  virtual ~QueryMethod() = default;
  [[nodiscard]] virtual Result<MethodAnswer> answer(const PosedPair& posed) = 0;
};

/// Name: full, base, global, grid or certified. The files must outlive the method.
/// Errors: kInvalidArgument where a solid is asked for whose model is open, or of a method that
/// knows no inside.
[[nodiscard]] Result<std::unique_ptr<QueryMethod>> make_query_method(
    const std::string& name, ModelFile& a, ModelFile& b, const QueryMethodOptions& options);

}  // namespace nearmesh::program
