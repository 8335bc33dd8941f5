// SPDX-License-Identifier: Apache-2.0
#include <limits>
#include <string>

#include "nearmesh/core/spm/detail/types.hpp"

namespace nearmesh {
namespace {

Status refuse(const std::string& why) {
  return {StatusCode::kInvalidArgument, "region request: " + why};
}

Status check_count(std::size_t found, std::size_t most, const std::string& what) {
  if (found == 0) return refuse("no " + what);
  if (found <= most) return Status::ok();
  return refuse("at most " + std::to_string(most) + " " + what + ", found " +
                std::to_string(found));
}

}  // namespace

std::string to_string(const NodeSpan& node) {
  return "node [" + std::to_string(node.begin()) + ", " +
         std::to_string(std::uint64_t{node.begin()} + node.size) + ")";
}

Status check_request(const RegionRequest& request) {
  NEARMESH_RETURN_IF_ERROR(check_count(request.attach.size(), kMaxAttachNodes, "attach nodes"));
  if (request.is_audit()) {
    if (request.attach.size() != 1 || !request.region.empty())
      return refuse("max_splits is 0, an audit: expected one node and no region");
  } else {
    NEARMESH_RETURN_IF_ERROR(check_count(request.region.size(), kMaxRegionBoxes, "region boxes"));
  }
  if (request.max_splits > kMaxRequestSplits)
    return refuse("max_splits must be in [0, " + std::to_string(kMaxRequestSplits) + "], found " +
                  std::to_string(request.max_splits));
  for (std::size_t i = 0; i < request.region.size(); ++i)
    if (const char* fault = fault_of(request.region[i]); fault != nullptr)
      return refuse("region box " + std::to_string(i) + ": " + fault);
  std::uint64_t end = 0;
  for (const NodeSpan& node : request.attach) {
    const std::uint64_t begin = node.begin();
    if (node.size < 2) return refuse("attach " + to_string(node) + " is empty or a leaf");
    if (begin + node.size > std::numeric_limits<std::uint32_t>::max())
      return refuse("attach " + to_string(node) + " is outside any model");
    if (begin < end) return refuse("attach nodes must ascend and not overlap");
    end = begin + node.size;
  }
  return Status::ok();
}

}  // namespace nearmesh
