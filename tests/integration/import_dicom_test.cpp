// palpate-import on DICOM series written here.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <functional>
#include <sstream>

#include "server/import/dicom_file.h"
#include "tests/integration/dicom_support.h"
#include "tests/support/process.h"

namespace palpate {
namespace {

namespace fs = std::filesystem;

TEST_F(DicomTest, SeriesIsSortedAndRescaled) {
  const fs::path folder = WriteSeries();
  Write("series/README.txt", "not a slice");
  const LoadedVolume volume = Imported(folder);
  ExpectSlices(volume);
  EXPECT_TRUE(volume.metadata.spacing_mm.isApprox(Vec3(0.5, 0.75, 2.0)));
  EXPECT_TRUE(volume.metadata.origin_W_mm.isApprox(Vec3(10, 20, 30)));
  EXPECT_TRUE(volume.metadata.direction.isApprox(Mat3::Identity()));
  EXPECT_EQ(volume.metadata.unit, "HU");
  EXPECT_EQ(volume.metadata.original_type, "int16");
  EXPECT_EQ(volume.metadata.source, "series");
  EXPECT_TRUE(warnings_.empty());
}

TEST_F(DicomTest, FlippedOrientationStaysRightHanded) {
  const LoadedVolume volume =
      Imported(WriteSeries([](SliceFile* s) { s->orientation = "0\\1\\0\\1\\0\\0"; }));
  EXPECT_NEAR(volume.metadata.direction.determinant(), 1.0, 1e-9);
  // The normal points down: the highest slice comes first.
  EXPECT_TRUE(volume.metadata.origin_W_mm.isApprox(Vec3(10, 20, 36)));
  EXPECT_EQ(At(volume, 3, 2, 0), 2 * PatternValue(3, 2, 3) - 1024);
}

TEST_F(DicomTest, TheUnitIsHuWhereTheRescaleLeadsToIt) {
  struct Case {
    const char* modality;
    const char* type;
    bool has_rescale;
    const char* unit;
  };
  const Case cases[] = {
      {"CT", "", true, "HU"}, {"CT", "HU", true, "HU"}, {"MR", "HU", true, "HU"},
      {"CT", "", false, ""},  {"CT", "US", true, ""},   {"MR", "", true, ""},
      {"MR", "US", true, ""}, {"CT", "OD", true, "OD"},
  };
  for (const Case& one : cases) {
    SCOPED_TRACE(std::string(one.modality) + " " + one.type);
    const fs::path folder = WriteSeries([&](SliceFile* s) {
      s->modality = one.modality;
      s->rescale_type = one.type;
      s->has_rescale = one.has_rescale;
    });
    EXPECT_EQ(Imported(folder).metadata.unit, one.unit);
    // That a CT has no unit is said.
    EXPECT_EQ(warnings_.size(), std::string(one.modality + std::string(one.unit)) == "CT");
  }
  EXPECT_EQ(Imported(WriteSeries([](SliceFile* s) { s->has_rescale = s->z != 2; })).metadata.unit,
            "");
}

TEST_F(DicomTest, LargestSeriesIsTakenWithAWarning) {
  const fs::path folder = WriteSeries();
  SliceFile other;
  other.series = "1.2.4";
  Write("series/other.dcm", PatternDicom(other));
  EXPECT_EQ(Imported(folder).metadata.size.z(), 4);
  EXPECT_EQ(warnings_.size(), 1u);
}

// Pixels of 0.5 x 0.75 mm.
TEST_F(DicomTest, SlicesBesideTheLineAreSaidOrRefused) {
  const auto shifted = [this](const std::vector<double>& x_mm) {
    return WriteSeries([&](SliceFile* s) {
      s->shift = std::to_string(x_mm[static_cast<std::size_t>(s->z)]) + "\\20\\";
    });
  };
  EXPECT_EQ(Imported(shifted({10, 10.04, 10, 10})).metadata.origin_W_mm.x(), 10.0);
  EXPECT_TRUE(warnings_.empty());
  EXPECT_EQ(Imported(shifted({10, 10.2, 10, 10})).metadata.origin_W_mm.x(), 10.0);
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find("'8.dcm' lies 0.2 mm"), std::string::npos) << warnings_[0];
  ExpectRefused(shifted({10, 16, 10, 10}), ErrorKind::kInvalidArgument, "'8.dcm' lies 6 mm");
  ExpectRefused(shifted({10, 10, 10, 16}), ErrorKind::kInvalidArgument, "'6.dcm' lies 6 mm");
  // With a slight tilt, the volume lies in the middle of what the slices drift.
  EXPECT_NEAR(Imported(shifted({10, 10.01, 10.02, 10.03})).metadata.origin_W_mm.x(), 10.015, 1e-6);
  EXPECT_TRUE(warnings_.empty());
}

// A tilt below the limit moves the ends of a long stack aside.
TEST_F(DicomTest, ASlightTiltIsSaidWithTheAmount) {
  const auto tilted = [this](double mm_per_slice) {
    return WriteSeries([=](SliceFile* s) {
      s->height_mm = 30.0 + 20.0 * s->z;
      s->shift = std::to_string(10.0 + mm_per_slice * s->z) + "\\20\\";
    });
  };
  Imported(tilted(0.1));
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find(" 0.3 mm"), std::string::npos) << warnings_[0];
  // Less than 1 %, but more than half a voxel at both ends.
  ExpectRefused(tilted(0.19), ErrorKind::kInvalidArgument, "tilted");
}

// At two pitches, as heads are scanned, whichever of them most slices have.
TEST_F(DicomTest, UnevenSlicesAreResampledAtTheirFinestSpacing) {
  const auto between = [](int x, int y, int z, double share) {
    return 2 * ((1 - share) * PatternValue(x, y, z) + share * PatternValue(x, y, z + 1)) - 1024;
  };
  const auto folder = [this](const std::vector<double>& heights_mm) {
    return WriteSeries(
        [&](SliceFile* s) { s->height_mm = heights_mm[static_cast<std::size_t>(s->z)]; });
  };
  const LoadedVolume volume = Imported(folder({30, 32, 37, 42}));
  ASSERT_EQ(volume.metadata.size, Vec3i(7, 5, 7));
  EXPECT_NEAR(volume.metadata.spacing_mm.z(), 2.0, 1e-9);
  EXPECT_TRUE(volume.metadata.origin_W_mm.isApprox(Vec3(10, 20, 30)));
  const std::pair<int, double> places[] = {{0, 0.0}, {1, 0.0}, {1, 0.4}, {1, 0.8},
                                           {2, 0.2}, {2, 0.6}, {2, 1.0}};
  for (int k = 0; k < 7; ++k) {
    for (const auto& [x, y] : {std::pair(3, 2), std::pair(6, 0)}) {
      EXPECT_NEAR(At(volume, x, y, k), between(x, y, places[k].first, places[k].second), 1e-4) << k;
    }
  }
  ASSERT_EQ(warnings_.size(), 1u);
  EXPECT_NE(warnings_[0].find("2 to 5 mm"), std::string::npos) << warnings_[0];
  // The mean is 1.27 mm. The last slice stays for the rest of its thickness.
  const LoadedVolume mild = Imported(folder({30, 31, 32.4, 33.8}));
  ASSERT_EQ(mild.metadata.size.z(), 5);
  EXPECT_NEAR(At(mild, 3, 2, 2), between(3, 2, 1, 1 / 1.4), 1e-3);
  EXPECT_EQ(At(mild, 3, 2, 4), 2 * PatternValue(3, 2, 3) - 1024);
  // The user's spacing stands for all.
  const LoadedVolume stated =
      Imported(Source{.path = folder({30, 32, 37, 42}), .spacing_mm = Vec3(0.5, 0.75, 4)});
  ExpectSlices(stated);
  EXPECT_TRUE(warnings_.empty());

  const auto run = test::Process({test::kPalpateImport, folder({30, 32, 37, 42}).string(),
                                  Path("o.vdb").string(), "--no-resample"},
                                 std::chrono::seconds(120))
                       .Wait();
  EXPECT_EQ(run.exit_code, ExitCode(ErrorKind::kInvalidArgument));
  EXPECT_NE(run.error.find("2 to 5 mm"), std::string::npos) << run.error;
}

// Limits hold for what is interpolated, too.
TEST_F(DicomTest, ManySlicesFromFewAreOverTheLimit) {
  const fs::path folder = WriteSeries([](SliceFile* s) {
    s->height_mm = std::vector<double>{0, 1, 10, 19}[static_cast<std::size_t>(s->z)];
  });
  ExpectRefused(Source{.path = folder, .max_voxels = 500}, ErrorKind::kTooLarge, "limit");
}

TEST_F(DicomTest, UnevenPitchIsWarnedOf) {
  const LoadedVolume volume = Imported(WriteSeries([](SliceFile* s) {
    if (s->z == 3) s->height_mm += 0.2;
  }));
  EXPECT_EQ(warnings_.size(), 1u);
  EXPECT_NEAR(volume.metadata.spacing_mm.z(), 6.2 / 3, 1e-9);
}

TEST_F(DicomTest, PaddingBehindThePixelsIsNoPartOfTheSlice) {
  std::string element;
  Append(&element, 0xfffc, 0xfffc, "OB", std::string(100, 'x'));
  for (const std::string& padding : {std::string(1, '\0'), std::string(4096, '\0'),
                                     std::string("junk"), element + std::string(9, '\0')}) {
    SCOPED_TRACE(padding.size());
    ExpectSlices(Imported(WriteSeries(nullptr, padding)));
  }
}

// One import beside another: see TIMES in tests/CMakeLists.txt.
TEST_F(DicomTest, PaddingCostsNoTime) {
  const auto shortest_s = [this](const std::string& padding) {
    const fs::path folder = WriteSeries(nullptr, padding);
    double shortest = 1e9;
    for (int run = 0; run < 3; ++run) {
      const auto start = std::chrono::steady_clock::now();
      Imported(folder);
      const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
      shortest = std::min(shortest, taken.count());
    }
    return shortest;
  };
  const double plain_s = shortest_s(""), padded_s = shortest_s(std::string(1 << 20, '\0'));
  std::printf("%.3f s without padding, %.3f s with it\n", plain_s, padded_s);
  EXPECT_LT(padded_s, 5.0 * plain_s);
}

TEST_F(DicomTest, AttacksAreRefused) {
  // Of one slice, or of each.
  const auto refused = [this](const std::string& text, std::optional<int> z,
                              const std::function<void(SliceFile*)>& change) {
    const fs::path folder = WriteSeries([&](SliceFile* s) {
      if (!z || s->z == *z) change(s);
    });
    ExpectRefused(folder, ErrorKind::kInvalidArgument, text);
  };
  refused("missing", 3, [](SliceFile* s) { s->height_mm += 2.0; });
  refused("same place", 3, [](SliceFile* s) { s->height_mm -= 2.0; });
  refused("same place", {}, [](SliceFile* s) { s->height_mm = 7.0; });
  refused("differ", 2, [](SliceFile* s) { s->columns = 6; });
  refused("differ", 2, [](SliceFile* s) { s->orientation = "0\\1\\0\\1\\0\\0"; });
  refused("unit vectors", {}, [](SliceFile* s) { s->orientation = "2\\0\\0\\0\\1\\0"; });
  refused("position", {}, [](SliceFile* s) { s->shift = "nan\\0\\"; });
  refused("position", {}, [](SliceFile* s) { s->shift = "abc\\0\\"; });
  refused("tilt", {}, [](SliceFile* s) { s->shift = std::to_string(s->z) + "\\0\\"; });
  WriteSeries();
  for (const char* name : {"series/6.dcm", "series/7.dcm", "series/8.dcm"}) fs::remove(Path(name));
  ExpectRefused(Path("series"), ErrorKind::kInvalidArgument, "single");
}

// Cut between two elements, it may pass for a file without an image.
TEST_F(DicomTest, ATruncatedSliceIsRefusedOrIsNone) {
  const std::string whole = PatternDicom(PatternSlice(2));
  for (std::size_t length = 0; length < whole.size(); ++length) {
    std::istringstream in(whole.substr(0, length));
    try {
      EXPECT_FALSE(CheckDicomFile(&in, static_cast<std::int64_t>(length)).has_pixels) << length;
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInvalidArgument) << length;
    }
  }
  WriteSeries();
  for (const std::size_t cut : {1, 300}) {
    Write("series/7.dcm", whole.substr(0, whole.size() - cut));
    ExpectRefused(Path("series"), ErrorKind::kInvalidArgument, "");
  }
}

}  // namespace
}  // namespace palpate
