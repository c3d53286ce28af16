// Any bytes as a MetaImage file.
#include "server/import/meta_image_header.h"
#include "tests/fuzz/image_script.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  fuzz::ReadImage({data, size}, ImageFormat::kMetaImage, ParseMetaImageHeader);
  return 0;
}
