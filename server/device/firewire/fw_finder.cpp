#include "server/device/firewire/fw_finder.h"

#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <optional>

namespace palpate {
namespace {

namespace fs = std::filesystem;

std::string FirstLine(const fs::path& file) {
  std::string line;
  std::ifstream stream(file);
  std::getline(stream, line);
  return line;
}

// Calls take(folder, is_local) for each node. Units, fw1.0, are none.
template <class Take>
void ForEachNode(Take take) {
  std::error_code none;
  for (const fs::directory_entry& entry :
       fs::directory_iterator("/sys/bus/firewire/devices", none)) {
    const std::string name = entry.path().filename();
    if (!name.starts_with("fw") || name.find('.') != std::string::npos) continue;
    take(entry.path(), FirstLine(entry.path() / "is_local") == "1");
  }
}

std::optional<std::uint64_t> GuidOf(const fs::path& folder) {
  const std::string text = FirstLine(folder / "guid");  // "0x000b990080df6000"
  if (!text.starts_with("0x")) return std::nullopt;
  std::uint64_t guid = 0;
  const auto [end, error] = std::from_chars(text.data() + 2, text.data() + text.size(), guid, 16);
  if (error != std::errc()) return std::nullopt;
  return guid;
}

}  // namespace

std::vector<FwFound> FindFwNodes(std::uint32_t vendor) {
  constexpr int kVendorShift = 40;
  std::vector<FwFound> found;
  ForEachNode([&](const fs::path& folder, bool is_local) {
    const std::optional<std::uint64_t> guid = GuidOf(folder);
    if (is_local || !guid || *guid >> kVendorShift != vendor) return;
    const std::string node = "/dev/" + folder.filename().string();
    found.push_back({*guid, node, access(node.c_str(), R_OK | W_OK) == 0});
  });
  std::ranges::sort(found, {}, &FwFound::guid);
  return found;
}

bool HasFwController() {
  bool has = false;
  ForEachNode([&](const fs::path&, bool is_local) { has = has || is_local; });
  return has;
}

}  // namespace palpate
