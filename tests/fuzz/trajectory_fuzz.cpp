// Any bytes as a table of positions for palpate-lab.
#include "common/error/error.h"
#include "server/lab/trajectory_file.h"
#include "tests/fuzz/scratch_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace palpate;
  static const fuzz::ScratchFile file("hips.csv");
  file.Write({data, size});
  try {
    const std::vector<Vec3> hips_mm = lab::ReadTrajectory(file.path());
    FUZZ_CHECK(!hips_mm.empty());
    lab::WriteTrajectory(file.path(), hips_mm);
    FUZZ_CHECK(lab::ReadTrajectory(file.path()).size() == hips_mm.size());
  } catch (const Error&) {
  }
  return 0;
}
