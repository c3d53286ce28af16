// Voxels without a header, as somebody described them:
//
//   size 3 x i64, offset i64, type u8 (one beyond them is no type), big endian u8, voxels
#include <string>

#include "server/import/raw_header.h"
#include "tests/fuzz/image_script.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  static const fuzz::ScratchFile file("voxels");
  static const ImportLimits limits{.max_voxels = fuzz::kMostVoxels};
  fuzz::Input input({data, size});
  RawVoxels raw;
  for (std::int64_t& axis : raw.size) axis = input.Take<std::int64_t>();
  raw.offset_bytes = input.Take<std::int64_t>();
  const int type = input.Take<std::uint8_t>() % 9;
  raw.type = type < 8 ? Name(static_cast<ScalarType>(type)) : "float16";
  raw.big_endian = input.Take<std::uint8_t>() % 2 != 0;
  const auto voxels = input.TakeBytes(size);
  try {
    file.Write(voxels);
    const ImageHeader header = CheckedRawHeader(file.path(), raw, limits);
    fuzz::CheckHeader(header);
    FUZZ_CHECK(ReadVoxels(file.path(), header, 0) != nullptr);
  } catch (const Error&) {
  }
  return 0;
}
