// SPDX-License-Identifier: Apache-2.0
#include "nearmesh/core/spm/write_model_file.hpp"

#include "encode_model_file.hpp"
#include "file_layout.hpp"

namespace nearmesh {

Result<WrittenModel> write_model_file(const SpmHeader& header, const SplitStore& store,
                                      std::span<const FaceNumber> numbers, const std::string& path,
                                      unsigned threads, const MeshOrigin& origin) {
  const EncodedModel encoded = encode_model_file(header, store, numbers, threads, origin);
  NEARMESH_RETURN_IF_ERROR(write_file(path, file_layout::kModelFile, encoded.bytes));
  return encoded.written;
}

}  // namespace nearmesh
