// Any bytes as a DICOM file: what GDCM gets to see afterwards is whole.
#include <sstream>
#include <string>

#include "server/import/dicom_file.h"
#include "server/import/image_header.h"
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  std::istringstream in(std::string(data, data + size));
  try {
    const DicomFile file = CheckDicomFile(&in, static_cast<std::int64_t>(size));
    FUZZ_CHECK(file.is_dicom || !file.has_pixels);
    FUZZ_CHECK(!file.is_dicom || size > 131);
  } catch (const Error&) {
  }
  return 0;
}
