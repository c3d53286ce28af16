// palpate-import on DICOM series written here, and on DICOM as it is found: folders with odd files,
// and files that other readers read or repair.
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
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

namespace {

namespace fs = std::filesystem;

class DicomKindsTest : public DicomTest {
 protected:
  // One warning about the whole import, which holds the texts.
  void ExpectOneWarning(const std::vector<std::string>& texts) const {
    ASSERT_EQ(warnings_.size(), 1u);
    for (const std::string& text : texts) {
      EXPECT_NE(warnings_[0].find(text), std::string::npos) << text << ": " << warnings_[0];
    }
  }
  // The series, with another file.
  void ExpectLeftOut(const std::string& bytes, const std::string& why) {
    SCOPED_TRACE(why);
    const fs::path folder = WriteSeries();
    Write("series/a.dcm", bytes);
    ExpectSlices(Imported(folder));
    ExpectOneWarning({"'a.dcm'", why});
  }
  test::ProcessResult Run(std::vector<std::string> options) const {
    options.insert(options.begin(), {test::kPalpateImport, Path("series"), Path("o.vdb")});
    return test::Process(options, std::chrono::seconds(120)).Wait();
  }
};

TEST_F(DicomKindsTest, OneOddFileBlocksNoFolder) {
  const auto odd = [](const std::function<void(SliceFile*)>& change) {
    SliceFile slice = PatternSlice(7);
    change(&slice);
    return PatternDicom(slice);
  };
  const std::string slice = odd([](SliceFile*) {});
  ExpectLeftOut(odd([](SliceFile* s) { s->orientation = "1\\0\\0\\0\\0\\1"; }), "orientation");
  ExpectLeftOut(odd([](SliceFile* s) { s->columns = 6; }), "size");
  ExpectLeftOut(odd([](SliceFile* s) { s->spacing = "1\\1"; }), "spacing");
  ExpectLeftOut(odd([](SliceFile* s) { s->spacing = "x\\1"; }), "PixelSpacing");
  ExpectLeftOut(odd([](SliceFile* s) { s->series = "1.2.4"; }), "1.2.4");
  ExpectLeftOut(odd([](SliceFile* s) { s->photometric = "PALETTE COLOR"; }), "colour");
  ExpectLeftOut(odd([](SliceFile* s) { s->shift = "1\\"; }), "position");
  ExpectLeftOut(odd([](SliceFile* s) { s->syntax = "1.2.3.4"; }), "1.2.3.4");
  ExpectLeftOut(odd([](SliceFile* s) { s->frames = "1\\2"; }), "NumberOfFrames");
  ExpectLeftOut(slice.substr(0, slice.size() - 20), "truncated");
  ExpectLeftOut("text", "no DICOM");
}

TEST_F(DicomKindsTest, CopiesAreLeftOut) {
  SliceFile copy = PatternSlice(1);
  ExpectLeftOut(PatternDicom(copy), "copy");
  // Exported twice, by a program that gave each a new name.
  copy.instance = "1.2.5";
  ExpectLeftOut(PatternDicom(copy), "copy");
  // Which one is right?
  copy.z = 2;
  const fs::path folder = WriteSeries();
  Write("series/a.dcm", PatternDicom(copy));
  ExpectRefused(folder, ErrorKind::kInvalidArgument, "same place");
}

TEST_F(DicomKindsTest, TheUserChoosesTheSeries) {
  WriteSeries();
  for (const int z : {0, 1, 2}) {
    SliceFile other = PatternSlice(z);
    other.series = "1.2.4";
    Write("series/" + std::to_string(z), PatternDicom(other));
  }
  EXPECT_EQ(Run({"--series", "1.2.4"}).exit_code, 0);
  EXPECT_EQ(Imported(Path("o.vdb")).metadata.size.z(), 3);
  const test::ProcessResult none = Run({"--overwrite", "--series", "1.2.5"});
  EXPECT_EQ(none.exit_code, ExitCode(ErrorKind::kInvalidArgument));
  EXPECT_NE(none.error.find("1.2.3, 1.2.4"), std::string::npos) << none.error;
}

TEST_F(DicomKindsTest, ASeriesOfOwnNamesIsOne) {
  ExpectSlices(
      Imported(WriteSeries([](SliceFile* s) { s->series += "." + std::to_string(s->z); })));
  ExpectOneWarning({"SeriesInstanceUID"});
}

// As on a CD.
TEST_F(DicomKindsTest, SlicesBelowTheFolderAreFound) {
  WriteSeries();
  fs::create_directories(Path("cd/images/patient"));
  fs::create_directory(Path("cd/empty"));
  fs::rename(Path("series"), Path("cd/images/patient/one"));
  ExpectSlices(Imported(Path("cd")));
  ExpectOneWarning({"'images/patient/one'"});
  // What the folder holds itself comes first.
  for (const int z : {0, 1}) Write("cd/" + std::to_string(z), PatternDicom(PatternSlice(z)));
  EXPECT_EQ(Imported(Path("cd")).metadata.size.z(), 2);
  EXPECT_TRUE(warnings_.empty());
}

// By GDCM's rule.
TEST_F(DicomKindsTest, FilesWithoutAPreamble) {
  WriteSeries();
  const auto change = [&](const std::function<std::string(const std::string&)>& changed) {
    for (const auto& entry : fs::directory_iterator(Path("series"))) {
      Write("series/" + entry.path().filename().string(), changed(test::TextOf(entry.path())));
    }
    ExpectSlices(Imported(Path("series")));
    EXPECT_TRUE(warnings_.empty());
  };
  change([](const std::string& bytes) { return bytes.substr(132); });  // with meta information
  const auto image = [](const std::string& bytes) {
    return bytes.substr(bytes.find(std::string("\x08\0\x16\0UI", 6)));
  };
  change(image);
  change([&](const std::string& bytes) {  // of implicit types
    std::string out;
    for (std::size_t at = 0; at < bytes.size();) {
      const bool is_long = bytes.substr(at + 4, 2) == "OW";
      std::uint32_t length = 0;
      std::memcpy(&length, bytes.data() + at + (is_long ? 8 : 6), is_long ? 4 : 2);
      const std::size_t value = at + (is_long ? 12 : 8);
      out += bytes.substr(at, 4) + BytesOf(length) + bytes.substr(value, length);
      at = value + length;
    }
    return out;
  });
}

// What is not supported is no damage.
TEST_F(DicomKindsTest, WhatIsNotSupportedIsNamed) {
  const auto refused = [this](const std::string& text,
                              const std::function<void(SliceFile*)>& change) {
    const fs::path folder = WriteSeries(change);
    ExpectRefused(folder, ErrorKind::kInvalidArgument, text);
    try {
      ImportVolume(Source{.path = folder}.Request(), nullptr, nullptr);
    } catch (const Error& error) {
      const std::string line = error.what();
      EXPECT_NE(line.find("not supported"), std::string::npos) << line;
      EXPECT_EQ(line.find("damaged"), std::string::npos) << line;
    }
  };
  for (const std::uint16_t element : {8, 9}) {
    refused("float", [&](SliceFile* s) { s->pixels_element = element; });
  }
  for (const auto& [uid, name] : {std::pair("1.2.840.10008.1.2.1.99", "deflated"),
                                  {"1.2.840.10008.1.2.4.202", "HTJ2K"},
                                  {"1.2.840.10008.1.2.4.102", "MPEG-4"},
                                  {"1.2.840.113619.5.2", "1.2.840.113619.5.2"}}) {
    refused(name, [uid = uid](SliceFile* s) { s->syntax = uid; });
  }
  refused("frames", [](SliceFile* s) {
    s->frames = "2";
    s->rows = 2;
    s->pixels = std::string(100, '\0');
  });
}

TEST_F(DicomKindsTest, OddPixelSpacings) {
  const auto spacing = [this](const std::string& text, const std::string& type) {
    return Imported(WriteSeries([&](SliceFile* s) {
             s->spacing = text;
             s->spacing_type = type;
           }))
        .metadata.spacing_mm;
  };
  EXPECT_EQ(spacing("2.5\\0.125", "UT"), Vec3(0.125, 2.5, 2.0));
  EXPECT_TRUE(warnings_.empty());
  EXPECT_EQ(spacing("0,75\\0,125", "DS"), Vec3(0.125, 0.75, 2.0));
  ExpectOneWarning({"PixelSpacing", "6.dcm"});
  // The user's word stands for what the file does not say.
  for (const char* broken : {"0\\0", "x", "", "nan\\1", "-1\\1"}) {
    const fs::path folder = WriteSeries([&](SliceFile* s) { s->spacing = broken; });
    ExpectRefused(folder, ErrorKind::kInvalidArgument, "pacing");
    ExpectSlices(Imported(Source{.path = folder, .spacing_mm = Vec3(1, 2, 3)}));
    EXPECT_TRUE(warnings_.empty());
  }
}

TEST_F(DicomKindsTest, TheWindowIsThatOfTheSliceInTheMiddle) {
  const auto with_window = [this](const std::string& level, const std::string& width) {
    return Imported(WriteSeries([&](SliceFile* s) {
             s->has_rescale = false;
             Append(&s->elements, 0x28, 0x1050, "DS", s->z == 2 ? level : "1");
             Append(&s->elements, 0x28, 0x1051, "DS", s->z == 2 ? width : "2");
           }))
        .metadata;
  };
  const VolumeMetadata first = with_window("700\\40", "2600\\400");
  EXPECT_EQ(first.window_level, 700.0);
  EXPECT_EQ(first.window_width, 2600.0);
  for (const char* bad : {"", "-3", "wide", "nan"}) {
    EXPECT_EQ(with_window("700", bad).window_width, 0.0) << bad;
  }
}

TEST_F(DicomKindsTest, TheModalityLookupTableIsApplied) {
  // Value 10 v + 3 for v of 40 to 99.
  const auto with_table = [this](int bits, const std::string& type, bool has_length) {
    std::string entries, item, table;
    for (int v = 40; v < 100; ++v) {
      entries += bits == 8 ? std::string(1, static_cast<char>(v))
                           : BytesOf(static_cast<std::uint16_t>(10 * v + 3));
    }
    const std::uint16_t shape[] = {60, 40, static_cast<std::uint16_t>(bits)};
    Append(&item, 0x28, 0x3002, "US", BytesOf(shape[0]) + BytesOf(shape[1]) + BytesOf(shape[2]));
    Append(&item, 0x28, 0x3004, "LO", type);
    Append(&item, 0x28, 0x3006, "OW", entries);
    const std::string none("\xff\xff\xff\xff", 4);
    const std::string open = std::string("\xfe\xff\0\xe0", 4);
    table = has_length ? open + BytesOf(static_cast<std::uint32_t>(item.size())) + item
                       : open + none + item + std::string("\xfe\xff\x0d\xe0\0\0\0\0", 8);
    return Imported(WriteSeries([&](SliceFile* s) {
      s->has_rescale = false;
      Append(&s->elements, 0x28, 0x3000, "SQ", table);
    }));
  };
  for (const bool has_length : {true, false}) {
    const LoadedVolume volume = with_table(16, "HU", has_length);
    EXPECT_EQ(volume.metadata.unit, "HU");
    testing::ForEachVoxel(Vec3i(7, 5, 4), [&](const Vec3i& p) {
      const int stored = std::clamp(PatternValue(p.x(), p.y(), p.z()), 40, 99);
      ASSERT_EQ(At(volume, p.x(), p.y(), p.z()), 10 * stored + 3);
    });
  }
  const LoadedVolume bytes = with_table(8, "US", true);
  EXPECT_EQ(bytes.metadata.unit, "");
  EXPECT_EQ(At(bytes, 3, 2, 1), std::clamp(PatternValue(3, 2, 1), 40, 99));
}

// RLE: two planes of bytes, high and low, each in runs of literals.
TEST_F(DicomKindsTest, CompressedPixels) {
  ExpectSlices(Imported(WriteSeries([](SliceFile* s) {
    std::string planes[2];
    for (int plane = 0; plane < 2; ++plane) {
      for (int y = 0; y < 5; ++y) {
        planes[plane] += '\6';
        for (int x = 0; x < 7; ++x) {
          planes[plane] += static_cast<char>(plane == 0 ? 0 : PatternValue(x, y, s->z));
        }
      }
    }
    std::string fragment = BytesOf(std::uint32_t{2}) + BytesOf(std::uint32_t{64}) +
                           BytesOf(static_cast<std::uint32_t>(64 + planes[0].size()));
    fragment.resize(64);
    fragment += planes[0] + planes[1];
    s->syntax = "1.2.840.10008.1.2.5";
    s->has_fragments = true;
    s->pixels = std::string("\xfe\xff\0\xe0\0\0\0\0\xfe\xff\0\xe0", 12) +
                BytesOf(static_cast<std::uint32_t>(fragment.size())) + fragment +
                std::string("\xfe\xff\xdd\xe0\0\0\0\0", 8);
  })));
}

// A library in which reading crashes stands before GDCM and libtiff.
TEST_F(DicomKindsTest, ACrashNamesTheReader) {
#ifdef PALPATE_SANITIZED
  GTEST_SKIP() << "the sanitizers have handlers of their own";
#endif
  WriteSeries();
  Write("a.tif", "II");
  const fs::path build = fs::path(test::kPalpateImport).parent_path().parent_path();
  setenv("LD_PRELOAD", (build / "tests/libcrashing_readers.so").c_str(), 1);
  ExpectRefused(Path("series"), ErrorKind::kInternal, "reader of DICOM");
  ExpectRefused(Source{.path = Path("a.tif"), .spacing_mm = Vec3::Ones()}, ErrorKind::kInternal,
                "reader of TIFF");
  unsetenv("LD_PRELOAD");
}

}  // namespace

}  // namespace palpate
