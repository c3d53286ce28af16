// Any bytes as a NIfTI file, deflated or not.
#include "server/import/nifti_header.h"
#include "tests/fuzz/image_script.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  fuzz::ReadImage({data, size}, ImageFormat::kNifti, ParseNiftiHeader);
  return 0;
}
