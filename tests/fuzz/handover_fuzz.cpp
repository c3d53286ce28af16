// What the daemon takes over from an importer: a valid hand-over, dense or a tree, with bytes of
// the input laid over it. First byte: which. Then again and again: place (2 bytes, from the start
// or from kHandoverVoxels by its last bit), length, bytes.
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string>
#include <vector>

#include "common/error/error.h"
#include "server/volume/load/handover.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/support/written_handover.h"
#include "tests/support/written_tree.h"

namespace palpate::fuzz {
namespace {

std::string DenseBytes() {
  VolumeMetadata metadata;
  metadata.size = {9, 8, 7};
  metadata.value_max = 503.0;
  std::vector<float> voxels(9 * 8 * 7);
  for (std::size_t n = 0; n < voxels.size(); ++n) voxels[n] = static_cast<float>(n);
  const Descriptor file = MakeHandoverFile();
  testing::WriteHandover(file.get(), metadata, LeafType::kInt16, voxels);
  std::string bytes(kHandoverVoxels + 2 * voxels.size(), '\0');
  if (pread(file.get(), bytes.data(), bytes.size(), 0) < 0) std::abort();
  return bytes;
}

std::string TreeBytes() {
  testing::WrittenTree tree;
  tree.Count();
  return tree.Bytes();
}

void Overlay(const std::uint8_t* data, std::size_t size, std::string& bytes) {
  while (size > 3) {
    const std::size_t place = data[0] | data[1] << 8;
    const std::size_t at = place / 2 + (place % 2 ? kHandoverVoxels : 0);
    const std::size_t length = std::min<std::size_t>({data[2] % 16u, size - 3, bytes.size()});
    if (at + length <= bytes.size()) std::copy_n(data + 3, length, bytes.begin() + at);
    data += 3 + length;
    size -= 3 + length;
  }
}

}  // namespace
}  // namespace palpate::fuzz

FUZZ_TARGET(handover_fuzz) {
  using namespace palpate;
  if (size == 0) return 0;
  static const std::string dense = fuzz::DenseBytes(), tree = fuzz::TreeBytes();
  std::string bytes = data[0] % 2 ? tree : dense;
  fuzz::Overlay(data + 1, size - 1, bytes);
  const Descriptor file = MakeHandoverFile();
  if (write(file.get(), bytes.data(), bytes.size()) < 0) return 0;
  try {
    TakeHandover(file.get(), {.on_size = [](const Vec3i& volume_size, const LoadMemory&) {
                   // Large lattices are only slow.
                   if (volume_size.cast<std::int64_t>().prod() > 1 << 20) {
                     throw Error(ErrorKind::kTooLarge, "large");
                   }
                 }});
  } catch (const Error&) {
  }
  return 0;
}
