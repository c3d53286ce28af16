// DICOM as it is found: folders with odd files, and files that other readers read or repair.
#include <algorithm>
#include <chrono>
#include <cstdlib>

#include "tests/integration/dicom_support.h"
#include "tests/support/process.h"

namespace palpate {
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
