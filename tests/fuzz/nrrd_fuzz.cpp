// Any bytes as an NRRD file.
#include "server/import/nrrd_header.h"
#include "tests/fuzz/image_script.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  fuzz::ReadImage({data, size}, ImageFormat::kNrrd,
                  [](std::string_view head) { return ParseNrrdHeader(head, true); });
  return 0;
}
