#include "tests/integration/import_support.h"

#include <fstream>

#include "tests/support/places.h"
#include "tests/support/voxels.h"

namespace palpate {

std::filesystem::path ImportTest::Write(const std::string& name, const std::string& bytes) const {
  std::ofstream(Path(name), std::ios::binary) << bytes;
  return Path(name);
}

ImportRequest Source::Request() const {
  ImportRequest request;
  request.source = path;
  request.spacing_mm = spacing_mm;
  request.frame = frame;
  request.raw = raw;
  request.grid = grid;
  request.component = component;
  request.max_voxels = max_voxels;
  request.import_program = test::kPalpateImport;
  return request;
}

LoadedVolume ImportTest::Imported(const Source& source) {
  warnings_.clear();
  try {
    return ImportVolume(source.Request(), nullptr, nullptr, &warnings_);
  } catch (const Error& error) {
    ADD_FAILURE() << error.what();
    return {VolumeMetadata{}, BrickDirectory(Vec3i(2, 2, 2), [](const Vec3i&) {
              return Leaf::Constant(LeafType::kUint8, 0.0f);
            })};
  }
}

void ImportTest::ExpectRefused(const Source& source, ErrorKind kind, const std::string& text) {
  try {
    ImportVolume(source.Request(), nullptr, nullptr);
    ADD_FAILURE() << source.path << " was imported";
  } catch (const Error& error) {
    const std::string line = error.what();
    EXPECT_EQ(error.kind(), kind) << line;
    EXPECT_NE(line.find(text), std::string::npos) << line;
    EXPECT_EQ(line.rfind(source.path.string() + ": ", 0), 0u) << line;
    EXPECT_EQ(line.find('\n'), std::string::npos) << line;
  }
}

float At(const LoadedVolume& volume, int x, int y, int z) {
  return volume.bricks.Find(x, y, z)[VoxelInBrick(x, y, z)];
}

int PatternValue(int x, int y, int z) { return (11 * x + 23 * y + 37 * z) % 121; }

void ExpectPattern(const LoadedVolume& volume) {
  ASSERT_EQ(volume.metadata.size, Vec3i(kPatternSize[0], kPatternSize[1], kPatternSize[2]));
  testing::ForEachVoxel(volume.metadata.size, [&](const Vec3i& p) {
    ASSERT_EQ(At(volume, p.x(), p.y(), p.z()), PatternValue(p.x(), p.y(), p.z())) << p.transpose();
  });
}

}  // namespace palpate
