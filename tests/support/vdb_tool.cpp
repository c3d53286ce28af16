// vdb_tool make KIND EDGE FILE   writes a grid of tests/support/vdb_grids.h
// vdb_tool save FILE IMPORTER    saves two volumes to FILE by turns, until it is killed; says
//                                "saved" after each
#include <cstdio>
#include <cstdlib>
#include <string>

#include "common/error/error.h"
#include "server/volume/save/volume_export.h"
#include "tests/support/patterned_volume.h"
#include "tests/support/vdb_grids.h"

namespace palpate {
namespace {

void SaveByTurns(const char* path, const char* importer) {
  for (unsigned seed = 0;; seed = 1 - seed) {
    const auto volume = testing::ObliqueVolume(Vec3i(48, 40, 33), seed);
    ExportVolume(
        *volume, {path, true, importer}, [](std::string_view, double) {}, [] { return false; });
    std::printf("saved\n");
    std::fflush(stdout);
  }
}

int Run(const std::string& command, int count, char** arguments) {
  if (command == "make" && count == 3) {
    testing::WriteVdb(arguments[2], {testing::MakeVdbGrid(arguments[0], std::atoi(arguments[1]))});
    return 0;
  }
  if (command == "save" && count == 2) SaveByTurns(arguments[0], arguments[1]);
  return kUsageExitCode;
}

}  // namespace
}  // namespace palpate

int main(int count, char** arguments) {
  try {
    return palpate::Run(count > 1 ? arguments[1] : "", count - 2, arguments + 2);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "vdb_tool: %s\n", error.what());
    return 1;
  }
}
