// Which slices of a DICOM series make one volume, and what the bits of their pixels mean.
#include <chrono>

#include "tests/integration/dicom_support.h"
#include "tests/support/process.h"

namespace palpate {
namespace {

class DicomValuesTest : public DicomTest {
 protected:
  bool Warns(const std::string& text) const {
    for (const std::string& warning : warnings_) {
      if (warning.find(text) != std::string::npos) return true;
    }
    return false;
  }
  // The series, whose values are 2 v - 1024, with the pixels that `stored` gives.
  std::filesystem::path WritePixels(const std::function<int(int v)>& stored,
                                    const std::string& elements, bool has_rescale = true) {
    return WriteSeries([&](SliceFile* s) {
      s->elements = elements;
      s->has_rescale = has_rescale;
      for (int n = 0; n < 35; ++n) {
        const int v = PatternValue(n % 7, n / 7, s->z);
        s->pixels += BytesOf(static_cast<std::uint16_t>(stored(v)));
      }
    });
  }
  LoadedVolume WithPixels(const std::function<int(int v)>& stored, const std::string& elements,
                          bool has_rescale = true) {
    return Imported(WritePixels(stored, elements, has_rescale));
  }
  // Twice the series, the second with its slices the other way round. `mark`: of each slice, in the
  // first pass and in the second.
  void WriteTwoPasses(double shift_mm, const std::function<std::string(int pass, int z)>& mark) {
    WriteSeries([&](SliceFile* s) { s->elements = mark(0, s->z); });
    for (int z = 0; z < 4; ++z) {
      SliceFile slice = PatternSlice(3 - z);
      slice.instance = "1.2.4." + std::to_string(z);
      slice.height_mm = 30.0 + 2.0 * z + shift_mm;
      slice.elements = mark(1, z);
      Write("series/second" + std::to_string(z), PatternDicom(slice));
    }
  }
  test::ProcessResult Run(const std::string& option, const std::string& value) const {
    return test::Process(
               {test::kPalpateImport, Path("series"), Path("o.vdb"), "--overwrite", option, value},
               std::chrono::seconds(120))
        .Wait();
  }
  LoadedVolume Chosen(const std::string& option, const std::string& value) {
    const test::ProcessResult result = Run(option, value);
    EXPECT_EQ(result.exit_code, 0) << result.error;
    return Imported(Path("o.vdb"));
  }
};

std::string Element(std::uint16_t group, std::uint16_t element, const char* vr,
                    const std::string& value) {
  std::string out;
  Append(&out, group, element, vr, value);
  return out;
}

std::string Bits(int stored, int high, bool is_signed) {
  const auto u16 = [](int number) { return BytesOf(static_cast<std::uint16_t>(number)); };
  return Element(0x28, 0x101, "US", u16(stored)) + Element(0x28, 0x102, "US", u16(high)) +
         Element(0x28, 0x103, "US", u16(is_signed));
}

TEST_F(DicomValuesTest, PassesOverTheSameRangeAreToldApart) {
  struct Mark {
    std::uint16_t group, element;
    const char* vr;
    std::string first, second;
  };
  const std::string one = BytesOf(1.0), two = BytesOf(1000.0);
  for (const Mark& mark : {Mark{0x20, 0x12, "IS", "3", "4"},
                           {0x20, 0x100, "IS", "9", "10"},
                           {0x18, 0x81, "DS", "4.6", "9.2"},
                           {0x18, 0x86, "IS", "1", "2"},
                           {0x18, 0x1060, "DS", "0", "400"},
                           {0x18, 0x9087, "FD", one, two},
                           {0x08, 0x32, "TM", "101500", "101730"},
                           {0x18, 0x1210, "SH", "B30f", "B70s"}}) {
    SCOPED_TRACE(mark.element);
    for (const double shift_mm : {1.0, 0.0}) {
      WriteTwoPasses(shift_mm, [&](int pass, int) {
        return Element(0x18, 0x50, "DS", "2.0") +  // SliceThickness
               Element(mark.group, mark.element, mark.vr, pass == 0 ? mark.first : mark.second);
      });
      ExpectSlices(Imported(Path("series")));
      EXPECT_TRUE(Warns("--acquisition"));
      const std::string number = mark.element == 0x12 ? "4" : "2";
      const LoadedVolume second = Chosen("--acquisition", number);
      EXPECT_EQ(At(second, 3, 2, 0), 2 * PatternValue(3, 2, 3) - 1024);
      EXPECT_EQ(second.metadata.size.z(), 4);
    }
  }
  WriteTwoPasses(1.0,
                 [](int pass, int) { return Element(0x20, 0x12, "IS", pass == 0 ? "3" : "4"); });
  EXPECT_EQ(Chosen("--acquisition", "all").metadata.size.z(), 8);
  // A slice of its own changes nothing.
  SliceFile single = PatternSlice(1);
  single.height_mm += 0.5;
  single.instance = "1.2.5";
  single.elements = Element(0x20, 0x12, "IS", "9");
  Write("series/single", PatternDicom(single));
  ExpectSlices(Imported(Path("series")));
  EXPECT_NE(Run("--acquisition", "5").error.find("3, 4"), std::string::npos);
}

// A scanner that steps, measures in turns, rounds, or leaves something out here and there.
TEST_F(DicomValuesTest, StepsAndTurnsAreNoPasses) {
  const auto whole = [this](std::uint16_t group, std::uint16_t element, const char* vr,
                            const std::function<std::string(int z)>& text) {
    SCOPED_TRACE(element);
    const auto folder = WriteSeries([&](SliceFile* s) {
      s->elements = Element(0x18, 0x50, "DS", "1.8") + Element(group, element, vr, text(s->z));
    });
    ExpectSlices(Imported(folder));
    EXPECT_TRUE(warnings_.empty());
  };
  whole(0x20, 0x12, "IS", [](int z) { return z < 2 ? "1" : "2"; });
  whole(0x20, 0x12, "IS", [](int z) { return std::to_string(z); });
  whole(0x20, 0x12, "IS", [](int z) { return z == 1 ? "" : "1"; });
  whole(0x08, 0x32, "TM", [](int z) { return z % 2 == 0 ? "1015" : "1017"; });
  whole(0x18, 0x1060, "DS", [](int z) { return z % 2 == 0 ? "0" : "400"; });
  whole(0x18, 0x60, "DS", [](int z) { return z % 2 == 0 ? "120" : "120.0"; });
  whole(0x20, 0x13, "IS", [](int z) { return std::to_string(z % 2 == 0 ? z : z + 10); });
}

// Each slice has a time of its own; the second pass goes on with the numbers, or begins again.
TEST_F(DicomValuesTest, NumbersTellPassesApart) {
  for (const int first : {10, 0}) {
    WriteTwoPasses(1.0, [&](int pass, int z) {
      return Element(0x18, 0x50, "DS", "2.0") +
             Element(0x20, 0x13, "IS", std::to_string(first * pass + z)) +
             Element(0x08, 0x33, "TM", std::to_string(101500 + 10 * pass + z));
    });
    ExpectSlices(Imported(Path("series")));
    EXPECT_TRUE(Warns("InstanceNumber 2"));
  }
}

TEST_F(DicomValuesTest, OfOneInstanceNameThePixelsTellCopies) {
  const auto write = [this](const std::string& second) {
    WriteTwoPasses(0.0, [&](int pass, int) {
      return Element(0x20, 0x12, "IS", pass == 0 ? "3" : second) +
             Element(0x08, 0x18, "UI", "1.2.3.4");
    });
    return Imported(Path("series"));
  };
  ExpectSlices(write("4"));
  EXPECT_TRUE(Warns("--acquisition"));
  EXPECT_EQ(write("3").metadata.size.z(), 4);
  EXPECT_TRUE(Warns("copy"));
}

TEST_F(DicomValuesTest, ThePassIsOfTheSeriesThatIsTaken) {
  WriteTwoPasses(1.0, [](int pass, int) {
    return Element(0x18, 0x50, "DS", "2.0") + Element(0x20, 0x12, "IS", pass == 0 ? "3" : "4");
  });
  for (const int z : {0, 1, 2}) {
    SliceFile other = PatternSlice(z);
    other.series = "1.2.9";
    other.elements = Element(0x20, 0x12, "IS", "4");
    Write("series/other" + std::to_string(z), PatternDicom(other));
  }
  EXPECT_EQ(Chosen("--acquisition", "4").metadata.size.z(), 4);
}

TEST_F(DicomValuesTest, TheBitsThatAreStoredHaveTheSign) {
  const auto expect = [](const LoadedVolume& volume, int least) {
    EXPECT_EQ(volume.metadata.value_min, 2.0 * least - 1024);
    EXPECT_EQ(At(volume, 3, 2, 1), 2 * (PatternValue(3, 2, 1) - 60) - 1024);
  };
  const auto value = [](int v) { return v - 60; };
  expect(WithPixels(value, Bits(12, 11, true)), -60);
  EXPECT_TRUE(warnings_.empty());
  expect(WithPixels([&](int v) { return value(v) & 0xfff; }, Bits(12, 11, true)), -60);
  EXPECT_TRUE(Warns("earlier versions"));
  expect(WithPixels([&](int v) { return value(v) * 16; }, Bits(12, 15, true)), -60);
  // An overlay above.
  expect(WithPixels([&](int v) { return (value(v) & 0xfff) | 0x5000; }, Bits(12, 11, true)), -60);
  EXPECT_TRUE(Warns("left out"));
  const LoadedVolume all = WithPixels([](int v) { return v + 40000; }, Bits(16, 15, false));
  EXPECT_EQ(At(all, 3, 2, 1), 2 * (PatternValue(3, 2, 1) + 40000) - 1024);
  WithPixels(value, Bits(12, 5, true));
  EXPECT_TRUE(Warns("contradict"));
  // Signs above show that numbers have all bits, if slices agree.
  const std::string twelve = Bits(12, 11, true);
  const LoadedVolume wide = WithPixels([](int v) { return v % 2 == 0 ? -9 : 2500 + v; }, twelve);
  EXPECT_EQ(At(wide, 3, 2, 0), 2 * (2500 + PatternValue(3, 2, 0)) - 1024);
  ExpectRefused(WritePixels([](int v) { return v == 0 ? -9 : 2500 + v; }, twelve),
                ErrorKind::kInvalidArgument, "contradict each other");
}

// JPEG-LS of 7 x + 11 y - 60 in 12 bits, without a sign above.
TEST_F(DicomValuesTest, WhatACompressedStreamSaysOfItsBitsCounts) {
  constexpr char kStream[] =
      "ffd8fff7000b100005000701011100fff8000d01ffff0012004301140040ffda000801010000000000f0f036"
      "05c1303c160b05a0740c82a088340e8640a0505050403f9c54040400000000000008ff7a0041582a0280807f"
      "282d014070ffd900";
  std::string stream;
  for (const char* digit = kStream; *digit; digit += 2) {
    stream += static_cast<char>(std::stoi(std::string(digit, 2), nullptr, 16));
  }
  for (const auto& [stored, value, warning] :
       {std::tuple(12, -17, "sign"), std::tuple(6, 4079, "need more")}) {
    const LoadedVolume volume = Imported(WriteSeries([&, stored = stored](SliceFile* s) {
      s->syntax = "1.2.840.10008.1.2.4.80";
      s->elements = Bits(stored, stored - 1, true);
      s->has_fragments = true;
      s->pixels = std::string("\xfe\xff\0\xe0\0\0\0\0\xfe\xff\0\xe0", 12) +
                  BytesOf(static_cast<std::uint32_t>(stream.size())) + stream +
                  std::string("\xfe\xff\xdd\xe0\0\0\0\0", 8);
    }));
    EXPECT_EQ(At(volume, 3, 2, 1), 2 * value - 1024);
    EXPECT_TRUE(Warns(warning)) << stored;
  }
}

TEST_F(DicomValuesTest, PaddingIsOutside) {
  const auto padding = [](const char* vr, int from, int to) {
    return Element(0x28, 0x120, vr, BytesOf(static_cast<std::uint16_t>(from))) +
           Element(0x28, 0x121, vr, BytesOf(static_cast<std::uint16_t>(to)));
  };
  for (const auto& [first, last, bits, vr] :
       {std::tuple(63536, 63536, Bits(16, 15, false), "US"),
        std::tuple(63536, 63600, Bits(12, 11, false), "US")}) {
    const LoadedVolume volume = WithPixels(
        [&, first = first, last = last](int v) { return v == 0   ? first
                                                        : v == 1 ? last
                                                                 : v; },
        bits + padding(vr, first, last));
    EXPECT_EQ(volume.metadata.value_min, 2.0 * 3 - 1024);  // no voxel has 2
    EXPECT_EQ(volume.metadata.value_max, 2.0 * 120 - 1024);
    EXPECT_EQ(At(volume, 0, 0, 0), 2.0f * 3 - 1024);
    EXPECT_TRUE(Warns("padding"));
  }
  // What is outside anyway stays.
  for (const int below : {0, -2000}) {
    const auto black =
        WithPixels([below](int v) { return v == 0 ? below : v; }, padding("SS", below, below));
    EXPECT_EQ(black.metadata.value_min, 2.0 * below - 1024);
    EXPECT_TRUE(warnings_.empty());
  }
}

TEST_F(DicomValuesTest, WhatIsEncodedOtherwiseThanStatedIsRead) {
  ExpectSlices(Imported(WriteSeries([](SliceFile* s) { s->syntax = "1.2.840.10008.1.2"; })));
  EXPECT_TRUE(Warns("encoded otherwise"));
}

TEST_F(DicomValuesTest, SlicesWithoutAPlaceHaveAnOrder) {
  const auto without = [this](const std::string& elements) {
    return WriteSeries([&](SliceFile* s) {
      s->has_place = false;
      s->elements = elements;
    });
  };
  ExpectSlices(Imported(without(Element(0x18, 0x88, "DS", "2.5"))));
  EXPECT_TRUE(Warns("InstanceNumber"));
  ExpectRefused(without(""), ErrorKind::kInvalidArgument, "--spacing-mm");
  const LoadedVolume given = Imported(Source{.path = without(""), .spacing_mm = Vec3(1, 2, 3)});
  ExpectSlices(given);
  EXPECT_EQ(given.metadata.patient_axes, "");
  ExpectSlices(Imported(WriteSeries([](SliceFile* s) { s->orientation = "0\\0\\0\\0\\0\\0"; })));
  EXPECT_TRUE(Warns("ImagePositionPatient"));
  const LoadedVolume located = Imported(WriteSeries([](SliceFile* s) {
    s->has_place = false;
    s->elements = Element(0x20, 0x1041, "DS", std::to_string(-7 + 3 * s->z));
  }));
  ExpectSlices(located);
  EXPECT_EQ(located.metadata.spacing_mm.z(), 3.0);
}

TEST_F(DicomValuesTest, MosaicsAndEnhancedImagesAreNamed) {
  const auto refused = [this](const std::string& elements, const std::string& text) {
    const auto folder = WriteSeries([&](SliceFile* s) {
      s->has_place = false;
      s->elements = elements;
    });
    ExpectRefused(folder, ErrorKind::kInvalidArgument, text);
    ExpectRefused(folder, ErrorKind::kInvalidArgument, "dcm2niix");
  };
  refused(Element(0x8, 0x8, "CS", "ORIGINAL\\PRIMARY\\M\\ND\\MOSAIC"), "mosaic");
  refused(Element(0x5200, 0x9230, "SQ", ""), "enhanced");
}

TEST_F(DicomValuesTest, UnitsThatTheValuesDenyAreNone) {
  const std::string claim =
      Element(0x28, 0x1052, "DS", "0") + Element(0x28, 0x1053, "DS", "1") + Bits(16, 15, false);
  const auto shifted = [](int v) { return v < 60 ? v / 10 : 1000 + v / 10; };
  EXPECT_EQ(WithPixels(shifted, claim, false).metadata.unit, "");
  EXPECT_TRUE(Warns("--rescale -1024"));
  const LoadedVolume right = Chosen("--rescale", "-1024");
  EXPECT_EQ(right.metadata.unit, "HU");
  EXPECT_EQ(right.metadata.value_min, -1024.0);
  EXPECT_EQ(WithPixels([](int v) { return v < 60 ? v / 10 : 5 * v; }, claim, false).metadata.unit,
            "");
  EXPECT_FALSE(Warns("--rescale -1024"));
  // What is right stays: soft tissue and contrast alone, or with bone.
  const std::string signed_claim = claim + Bits(16, 15, true);
  const std::string offset = signed_claim + Element(0x28, 0x1052, "DS", "-1024");
  const auto kept = [&](const std::function<int(int v)>& value, const std::string& elements) {
    EXPECT_EQ(WithPixels(value, elements, false).metadata.unit, "HU");
    EXPECT_TRUE(warnings_.empty());
  };
  kept([](int v) { return 1024 + (v < 60 ? 50 : 350); }, offset);
  kept([](int v) { return 1024 + (v < 90 ? v / 2 + 30 : 900 + v); }, offset);
  kept([&](int v) { return shifted(v) - 1024; }, signed_claim);
}

}  // namespace
}  // namespace palpate
