// palpate-import on real volumes, described in the README of their folder. Skipped
// where the folder is missing: most of them may not be redistributed.
#include <set>
#include <sstream>

#include "tests/integration/import_support.h"
#include "tests/support/data_folder.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

using testing::DataFolder;

using RealDataTest = ImportTest;

// File, size, spacing (mm), least and greatest value, type.
class RealVolumeTest : public ImportTest, public ::testing::WithParamInterface<const char*> {};

TEST_P(RealVolumeTest, IsImported) {
  std::string file, type;
  Vec3i size;
  Vec3 spacing_mm;
  double value_min = 0.0, value_max = 0.0;
  std::istringstream row(GetParam());
  row >> file >> size.x() >> size.y() >> size.z() >> spacing_mm.x() >> spacing_mm.y() >>
      spacing_mm.z() >> value_min >> value_max >> type;
  ASSERT_TRUE(row);
  const fs::path path = DataFolder() / file;
  if (!fs::exists(path)) GTEST_SKIP() << path << " is missing; set PALPATE_DATA_DIR";
  const VolumeMetadata metadata = Imported(path).metadata;
  EXPECT_EQ(metadata.size, size);
  EXPECT_TRUE(metadata.spacing_mm.isApprox(spacing_mm, 1e-4)) << metadata.spacing_mm.transpose();
  EXPECT_NEAR(metadata.value_min, value_min, 1e-3);
  EXPECT_NEAR(metadata.value_max, value_max, 1e-3);
  EXPECT_EQ(metadata.original_type, type);
  EXPECT_EQ(metadata.source, path.filename().string());
}

INSTANTIATE_TEST_SUITE_P(
    All, RealVolumeTest,
    ::testing::Values(
        "paper/daisy_192x180x168_uint8.nhdr 192 180 168 1 1 1 0 254 uint8",
        "paper/orange_256x256x64_uint8.nhdr 256 256 64 0.390625 0.390625 1 0 228 uint8",
        "paper/lobster_301x324x56_uint8.nhdr 301 324 56 1 1 1.4 0 255 uint8",
        "paper/SUBST_head_ct_cranium_256x256x108_int16.nrrd "
        "256 256 108 0.957031 0.957031 1.5 -1024 2986 int16",
        "medical/dicom_mr_brain_20 256 256 20 0.859375 0.859375 7.000524 0 1059 int16",
        "medical/LIDC2.mha 256 256 133 1.40625 1.40625 2.5 0 255 uint8",
        "medical/HeadMRVolume.mhd 48 62 42 4 4 4 0 255 uint8",
        "medical/CT_pitch.nii.gz 175 248 58 0.8125 0.8125 2.39705 0 255 uint8",
        "medical/avg152T1_RL_nifti.nii.gz 91 109 91 2 2 2 0 255 uint8",
        "medical/nibabel_anatomical_bigendian.nii 33 41 25 2 2 2 -610 30393 int16",
        "classic/hydrogen_64x64x64_float32.nrrd 64 64 64 1 1 1 0 1 float32",
        "classic/walnut_128x96x114_uint16.nrrd "
        "128 96 114 0.015625 0.015625 0.015625 0 22526 uint16",
        "timeseries/isabel_125x125x25_float64_t30.nrrd "
        "125 125 25 4.00803 4.00803 4.04082 0 78.65941 float64"),
    [](const auto& volume) {
      const std::string row = volume.param;
      std::string name = row.substr(0, row.find(' '));
      for (char& c : name) c = std::isalnum(c) ? c : '_';
      return name;
    });

// Both are 4-D; the affine of the first is published with nibabel.
TEST_F(RealDataTest, Series) {
  const fs::path nifti2 = DataFolder() / "medical" / "nibabel_example_nifti2.nii.gz";
  const fs::path functional = DataFolder() / "timeseries" / "nibabel_functional.nii";
  if (!fs::exists(nifti2) || !fs::exists(functional)) {
    GTEST_SKIP() << nifti2 << " is missing; set PALPATE_DATA_DIR";
  }
  const VolumeMetadata metadata = Imported({.path = nifti2, .frame = 1}).metadata;
  EXPECT_EQ(metadata.frames, 2);
  EXPECT_EQ(metadata.size, Vec3i(32, 20, 12));
  EXPECT_TRUE(metadata.spacing_mm.isApprox(Vec3(2, 2, 2.2), 1e-4));
  EXPECT_TRUE(metadata.origin_W_mm.isApprox(Vec3(-117.855, 35.7229, -7.24880), 1e-4));
  EXPECT_NEAR(metadata.direction(1, 1), -0.98686, 1e-4);
  std::set<double> greatest;
  for (const int frame : {0, 7, 19}) {
    const VolumeMetadata of_frame = Imported({.path = functional, .frame = frame}).metadata;
    EXPECT_EQ(of_frame.frames, 20);
    EXPECT_EQ(of_frame.size, Vec3i(17, 21, 3));
    EXPECT_GE(of_frame.value_min, 629);
    EXPECT_LE(of_frame.value_max, 5572);
    greatest.insert(of_frame.value_max);
  }
  EXPECT_GT(greatest.size(), 1u);
  ExpectRefused({.path = functional, .frame = 20}, ErrorKind::kInvalidArgument, "from 0 to 19");
}

}  // namespace
}  // namespace palpate
