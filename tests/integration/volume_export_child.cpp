// volume_export_child PATH: saves two volumes to PATH in turn, until it is killed.
// Says "saved" after each.
#include <cstdio>

#include "common/error/error.h"
#include "server/volume/volume_export.h"
#include "tests/support/patterned_volume.h"

int main(int count, char** arguments) {
  using namespace palpate;
  if (count != 2) return kUsageExitCode;
  try {
    for (unsigned seed = 0;; seed = 1 - seed) {
      const auto volume = testing::ObliqueVolume(Vec3i(48, 40, 33), seed);
      ExportVolume(
          *volume, {.path = arguments[1], .overwrite = true}, [](std::string_view, double) {},
          [] { return false; });
      std::printf("saved\n");
      std::fflush(stdout);
    }
  } catch (const Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return ExitCode(error.kind());
  }
}
