#include "server/import/dicom_syntax.h"

#include <algorithm>
#include <iterator>
#include <string_view>
#include <utility>

#include "server/import/image_header.h"

namespace palpate {
namespace {

constexpr std::string_view kRoot = "1.2.840.10008.1.2";

// Behind kRoot: implicit and explicit, big endian; JPEG, JPEG-LS, JPEG 2000; RLE.
constexpr std::string_view kRead[] = {"",      ".1",    ".2",    ".4.50", ".4.51", ".4.53", ".4.55",
                                      ".4.57", ".4.70", ".4.80", ".4.81", ".4.90", ".4.91", ".5"};

constexpr std::pair<std::string_view, std::string_view> kNames[] = {
    {".1.98", "encapsulated uncompressed"},
    {".1.99", "deflated"},
    {".4.92", "JPEG 2000 part 2"},
    {".4.93", "JPEG 2000 part 2"},
    {".4.94", "JPIP"},
    {".4.95", "JPIP"},
    {".4.100", "MPEG-2"},
    {".4.101", "MPEG-2"},
    {".4.102", "MPEG-4"},
    {".4.103", "MPEG-4"},
    {".4.104", "MPEG-4"},
    {".4.105", "MPEG-4"},
    {".4.106", "MPEG-4"},
    {".4.107", "HEVC"},
    {".4.108", "HEVC"},
    {".4.110", "JPEG XL"},
    {".4.111", "JPEG XL"},
    {".4.112", "JPEG XL"},
    {".4.201", "HTJ2K, high-throughput JPEG 2000"},
    {".4.202", "HTJ2K, high-throughput JPEG 2000"},
    {".4.203", "HTJ2K, high-throughput JPEG 2000"},
    {".4.204", "JPIP HTJ2K"},
    {".4.205", "JPIP HTJ2K"},
};

}  // namespace

void CheckDicomSyntax(const std::string& uid) {
  if (uid.empty()) return;
  std::string name;
  if (uid.starts_with(kRoot)) {
    const std::string_view rest = std::string_view(uid).substr(kRoot.size());
    if (std::ranges::find(kRead, rest) != std::end(kRead)) return;
    const auto* const known =
        std::ranges::find_if(kNames, [&](const auto& one) { return one.first == rest; });
    if (known != std::end(kNames)) name = std::string(known->second) + ", ";
  }
  Refuse("its encoding (transfer syntax " + name + Quoted(uid) +
         ") is not supported; export the series uncompressed, as Explicit VR Little Endian");
}

}  // namespace palpate
