// SPDX-License-Identifier: Apache-2.0
#include "fastdds.hpp"

#include <dlfcn.h>
#include <link.h>

#include <cstring>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <memory>
#include <string_view>

#include "fastdds_api.hpp"

namespace nearmesh::wire {
namespace {

/// A loaded library's tables of what it asks of others.
struct Imports {
  const char* names = nullptr;
  const ElfW(Sym) * symbols = nullptr;
  const ElfW(Rela) * relocations[2]{};
  std::size_t counts[2]{};
};

Imports imports_of(ElfW(Addr) base, const ElfW(Dyn) * entry) {
  Imports found;
  // The loader has turned these addresses into absolute ones in most systems, not in all.
  const auto address = [base](ElfW(Addr) value) { return value < base ? base + value : value; };
  for (; entry->d_tag != DT_NULL; ++entry) {
    const ElfW(Addr) value = entry->d_un.d_ptr;
    if (entry->d_tag == DT_STRTAB) found.names = reinterpret_cast<const char*>(address(value));
    if (entry->d_tag == DT_SYMTAB)
      found.symbols = reinterpret_cast<const ElfW(Sym)*>(address(value));
    if (entry->d_tag == DT_JMPREL)
      found.relocations[0] = reinterpret_cast<const ElfW(Rela)*>(address(value));
    if (entry->d_tag == DT_PLTRELSZ) found.counts[0] = entry->d_un.d_val / sizeof(ElfW(Rela));
    if (entry->d_tag == DT_RELA)
      found.relocations[1] = reinterpret_cast<const ElfW(Rela)*>(address(value));
    if (entry->d_tag == DT_RELASZ) found.counts[1] = entry->d_un.d_val / sizeof(ElfW(Rela));
  }
  return found;
}

bool asks_for(const Imports& imports, std::string_view name) {
  if (imports.names == nullptr || imports.symbols == nullptr) return false;
  for (std::size_t table = 0; table < 2; ++table)
    for (std::size_t i = 0; imports.relocations[table] != nullptr && i < imports.counts[table];
         ++i) {
      const std::size_t symbol = imports.relocations[table][i].r_info >> 32;  // ELF64_R_SYM
      if (symbol != 0 && name == imports.names + imports.symbols[symbol].st_name) return true;
    }
  return false;
}

struct Search {
  ElfW(Addr) base;
  bool asserts;
};

int look(dl_phdr_info* library, std::size_t, void* data) {
  auto& search = *static_cast<Search*>(data);
  if (library->dlpi_addr != search.base) return 0;
  for (int i = 0; i < library->dlpi_phnum; ++i)
    if (library->dlpi_phdr[i].p_type == PT_DYNAMIC)
      search.asserts =
          asks_for(imports_of(search.base, reinterpret_cast<const ElfW(Dyn)*>(
                                               search.base + library->dlpi_phdr[i].p_vaddr)),
                   "__assert_fail");
  return 1;
}

FastDdsLevel level_of(fdds::Log::Kind kind) {
  switch (kind) {
    case fdds::Log::Kind::Error:
      return FastDdsLevel::kError;
    case fdds::Log::Kind::Warning:
      return FastDdsLevel::kWarning;
    default:
      return FastDdsLevel::kInfo;
  }
}

class Consumer final : public fdds::LogConsumer {
 public:
  explicit Consumer(std::function<void(FastDdsLevel, const std::string&)> take)
      : take_(std::move(take)) {}
  void Consume(const fdds::Log::Entry& entry) override {
    take_(level_of(entry.kind), std::string(entry.context.category) + ": " + entry.message);
  }

 private:
  const std::function<void(FastDdsLevel, const std::string&)> take_;
};

}  // namespace

const char* fastdds_version() { return kFastDdsVersion; }

bool fastdds_asserts() {
  Dl_info info{};
  void* const of_fastdds = reinterpret_cast<void*>(&fdds::Log::SetVerbosity);
  if (dladdr(of_fastdds, &info) == 0) return false;
  Search search{reinterpret_cast<ElfW(Addr)>(info.dli_fbase), false};
  dl_iterate_phdr(look, &search);
  return search.asserts;
}

void take_fastdds_log(std::function<void(FastDdsLevel, const std::string&)> take) {
  fdds::Log::ClearConsumers();
  fdds::Log::RegisterConsumer(std::make_unique<Consumer>(std::move(take)));
}

void set_fastdds_level(FastDdsLevel level) {
  fdds::Log::SetVerbosity(level == FastDdsLevel::kError     ? fdds::Log::Kind::Error
                          : level == FastDdsLevel::kWarning ? fdds::Log::Kind::Warning
                                                            : fdds::Log::Kind::Info);
}

void speak_through_transports() {
  constexpr std::string_view kSettings =
      "<?xml version=\"1.0\"?><dds><library_settings>"
      "<intraprocess_delivery>OFF</intraprocess_delivery></library_settings></dds>";
  fdds::DomainParticipantFactory::get_instance()->load_XML_profiles_string(kSettings.data(),
                                                                           kSettings.size());
}

}  // namespace nearmesh::wire
