// Any bytes as a TIFF stack, through libtiff.
#include "server/import/tiff_stack.h"
#include "tests/fuzz/image_script.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  static const fuzz::ScratchFile file("stack.tif");
  static const ImportLimits limits{.max_voxels = fuzz::kMostVoxels};
  try {
    file.Write({data, size});
    const TiffStack stack = OpenTiffStack(file.path(), limits);
    FUZZ_CHECK(stack.files.size() == 1 &&
               stack.pages.size() == static_cast<std::size_t>(stack.header.size[2]));
    FUZZ_CHECK(ReadTiffVoxels(stack, [](double) {}) != nullptr);
  } catch (const Error&) {
  }
  return 0;
}
