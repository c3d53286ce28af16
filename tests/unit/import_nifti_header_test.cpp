// NIfTI-1 and NIfTI-2 headers: what is read, and attacks.
#include "server/import/file_headers.h"

#include <algorithm>
#include <cstring>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include <gtest/gtest.h>

#include "tests/unit/import_refusal.h"

namespace palpate {
namespace {

using Size = std::array<std::int64_t, 3>;

using testing::Refusal;

// A header of either version that is changed by the names of its fields.
class NiftiBytes {
 public:
  NiftiBytes(int version, bool swap)
      : version_(version),
        swap_(swap),
        bytes_(version == 1 ? kNifti1HeaderBytes : kNifti2HeaderBytes, '\0') {
    Put<std::int32_t>(0, static_cast<std::int32_t>(bytes_.size()));
    const int dim[8] = {3, 20, 11, 9, 1, 1, 1, 1};
    for (int k = 0; k < 8; ++k) Dim(k, dim[k]);
    Type(4, 16);
    for (int k = 0; k < 8; ++k) Pixdim(k, 1.0);
    Offset(version == 1 ? 352 : 544);
    Magic("n+");
  }

  NiftiBytes& Dim(int k, std::int64_t value) {
    return version_ == 1 ? Put<std::int16_t>(40 + 2 * k, value)
                         : Put<std::int64_t>(16 + 8 * k, value);
  }
  NiftiBytes& Type(int datatype, int bitpix) {
    Put<std::int16_t>(version_ == 1 ? 70 : 12, datatype);
    return Put<std::int16_t>(version_ == 1 ? 72 : 14, bitpix);
  }
  NiftiBytes& Pixdim(int k, double value) { return Real(76, 104, k, value); }
  NiftiBytes& Offset(double value) {
    return version_ == 1 ? Put<float>(108, value) : Put<std::int64_t>(168, value);
  }
  NiftiBytes& Slope(double value) { return Real(112, 176, 0, value); }
  NiftiBytes& Inter(double value) { return Real(116, 184, 0, value); }
  NiftiBytes& Units(int value) {
    return version_ == 1 ? Put<std::uint8_t>(123, value) : Put<std::int32_t>(500, value);
  }
  NiftiBytes& Qform(int code) { return Code(252, 344, code); }
  NiftiBytes& Sform(int code) { return Code(254, 348, code); }
  NiftiBytes& Quaternion(int k, double value) { return Real(256, 352, k, value); }
  NiftiBytes& Srow(int k, double value) { return Real(280, 400, k, value); }
  NiftiBytes& Magic(const std::string& letters) {
    const std::string magic = letters + std::to_string(version_);
    bytes_.replace(version_ == 1 ? 344 : 4, 3, magic);
    if (version_ == 2) bytes_.replace(8, 4, "\r\n\032\n");
    return *this;
  }
  std::string& bytes() { return bytes_; }
  ImageHeader Parse(const std::optional<NiftiForm>& form = {}) const {
    return ParseNiftiHeader(bytes_, form);
  }

 private:
  template <typename Number, typename Value>
  NiftiBytes& Put(std::size_t offset, Value value) {
    const auto number = static_cast<Number>(value);
    char bytes[sizeof(Number)];
    std::memcpy(bytes, &number, sizeof(Number));
    if (swap_) std::reverse(bytes, bytes + sizeof(Number));
    std::memcpy(bytes_.data() + offset, bytes, sizeof(Number));
    return *this;
  }
  NiftiBytes& Real(std::size_t first1, std::size_t first2, int k, double value) {
    return version_ == 1 ? Put<float>(first1 + 4 * k, value) : Put<double>(first2 + 8 * k, value);
  }
  NiftiBytes& Code(std::size_t offset1, std::size_t offset2, int code) {
    return version_ == 1 ? Put<std::int16_t>(offset1, code) : Put<std::int32_t>(offset2, code);
  }

  int version_;
  bool swap_;
  std::string bytes_;
};

struct Said {
  std::string all;  // the warnings
  ImageGeometry geometry;
};

Said Parsed(const NiftiBytes& bytes, const std::optional<NiftiForm>& form = {}) {
  const ImageHeader header = bytes.Parse(form);
  Said said{{}, header.geometry};
  for (const std::string& warning : header.warnings) said.all += warning + "\n";
  return said;
}

NiftiBytes& PutSform(NiftiBytes& bytes, int code) {
  const double rows[12] = {0, 0, 3, 10, 0.5, 0, 0, 20, 0, 0.25, 0, 30};
  for (int k = 0; k < 12; ++k) bytes.Srow(k, rows[k]);
  return bytes.Sform(code);
}

class NiftiHeader : public ::testing::TestWithParam<std::pair<int, bool>> {
 protected:
  NiftiBytes Bytes() const { return {GetParam().first, GetParam().second}; }
};

INSTANTIATE_TEST_SUITE_P(All, NiftiHeader,
                         ::testing::Values(std::pair(1, false), std::pair(1, true),
                                           std::pair(2, false), std::pair(2, true)),
                         [](const auto& name) {
                           return std::to_string(name.param.first) +
                                  (name.param.second ? "Big" : "Little");
                         });

TEST_P(NiftiHeader, IsRead) {
  const ImageHeader header = Bytes().Parse();
  EXPECT_EQ(header.size, (Size{20, 11, 9}));
  EXPECT_EQ(header.frames, 1);
  EXPECT_EQ(header.type, ScalarType::kInt16);
  EXPECT_EQ(header.big_endian, GetParam().second);
  EXPECT_EQ(header.skip_bytes, GetParam().first == 1 ? 352 : 544);
  const std::tuple<int, int, ScalarType> types[] = {
      {256, 8, ScalarType::kInt8},    {2, 8, ScalarType::kUint8},
      {512, 16, ScalarType::kUint16}, {8, 32, ScalarType::kInt32},
      {768, 32, ScalarType::kUint32}, {16, 32, ScalarType::kFloat32},
      {64, 64, ScalarType::kFloat64},
  };
  for (const auto& [code, bits, type] : types) {
    EXPECT_EQ(Bytes().Type(code, bits).Parse().type, type);
  }
}

TEST_P(NiftiHeader, Frames) {
  EXPECT_EQ(Bytes().Dim(0, 4).Dim(4, 7).Parse().frames, 7);
  EXPECT_EQ(Bytes().Dim(0, 7).Dim(4, 7).Parse().frames, 7);
  EXPECT_NE(Refusal([&] { Bytes().Dim(0, 5).Dim(5, 3).Parse(); }), "");
  EXPECT_NE(Refusal([&] { Bytes().Dim(0, 5).Dim(4, 7).Dim(5, 3).Parse(); }), "");
  EXPECT_NE(Refusal([&] { Bytes().Dim(0, 4).Dim(4, 0).Parse(); }), "");
  EXPECT_NE(Refusal([&] { Bytes().Dim(0, 4).Dim(4, -7).Parse(); }), "");
}

TEST_P(NiftiHeader, Scale) {
  EXPECT_EQ(Bytes().Slope(2.5).Inter(-3).Parse().slope, 2.5);
  EXPECT_EQ(Bytes().Slope(2.5).Inter(-3).Parse().intercept, -3.0);
  // No scale: the intercept does not count.
  EXPECT_EQ(Bytes().Slope(0).Inter(-3).Parse().slope, 1.0);
  EXPECT_EQ(Bytes().Slope(0).Inter(-3).Parse().intercept, 0.0);
}

// As nibabel and nifti_clib.
TEST_P(NiftiHeader, AScaleThatIsNoNumberIsNoneAndSaid) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const double odd : {nan, std::numeric_limits<double>::infinity()}) {
    const ImageHeader unscaled = Bytes().Slope(odd).Inter(odd).Parse();
    EXPECT_EQ(unscaled.slope, 1.0);
    EXPECT_EQ(unscaled.intercept, 0.0);
    EXPECT_NE(Parsed(Bytes().Slope(odd)).all.find("scl_slope"), std::string::npos);
    EXPECT_EQ(Bytes().Slope(2).Inter(odd).Parse().intercept, 0.0);
    EXPECT_NE(Parsed(Bytes().Slope(2).Inter(odd)).all.find("scl_inter"), std::string::npos);
  }
}

// As nibabel. 0 is no length; the user may state one.
TEST_P(NiftiHeader, OfANegativeSpacingTheAmountIsTaken) {
  NiftiBytes bytes = Bytes();
  for (const int qform : {0, 1}) {
    bytes.Pixdim(1, -2).Pixdim(2, 3).Pixdim(3, -4).Qform(qform);
    EXPECT_EQ(Parsed(bytes).geometry.spacing_mm, Vec3(2, 3, 4));
    EXPECT_NE(Parsed(bytes).all.find("negative"), std::string::npos);
  }
  bytes.Pixdim(1, 0);
  EXPECT_NE(Refusal([&] { bytes.Parse(); }).find("--spacing-mm"), std::string::npos);
  EXPECT_EQ(ParseNiftiHeader(bytes.bytes(), {}, true).geometry.spacing_mm.x(), 1.0);
  // The sform has a spacing of its own.
  NiftiBytes placed = Bytes();
  PutSform(placed, 1).Pixdim(1, 0);
  EXPECT_TRUE(placed.Parse().geometry.spacing_mm.isApprox(Vec3(0.5, 0.25, 3)));
}

// What the user states comes first.
TEST_P(NiftiHeader, ABrokenFormLeavesTheOthers) {
  NiftiBytes bytes = Bytes();
  bytes.Sform(1);  // all zero
  EXPECT_FALSE(Parsed(bytes).geometry.is_lps);
  EXPECT_NE(Parsed(bytes).all.find("sides are unknown"), std::string::npos);
  bytes.Qform(1).Quaternion(3, 5);
  for (const double row : {0.0, std::numeric_limits<double>::quiet_NaN()}) {
    bytes.Srow(0, row);
    EXPECT_EQ(Parsed(bytes).geometry.origin_W_mm, Vec3(-5, 0, 0));
    EXPECT_NE(Parsed(bytes).all.find("the qform is taken"), std::string::npos);
    EXPECT_NE(Refusal([&] { bytes.Parse(NiftiForm::kSform); }), "");
  }
}

// As nibabel: the datatype counts.
TEST_P(NiftiHeader, AnotherBitpixIsSaid) {
  for (const int bitpix : {0, 8}) {
    NiftiBytes bytes = Bytes();
    bytes.Type(4, bitpix);
    EXPECT_EQ(bytes.Parse().type, ScalarType::kInt16);
    EXPECT_NE(Parsed(bytes).all.find("bitpix"), std::string::npos);
  }
}

// A turn by 90 degrees about z, in RAS.
NiftiBytes& PutQform(NiftiBytes& bytes) {
  bytes.Qform(1).Quaternion(2, std::sqrt(0.5)).Pixdim(1, 0.5).Pixdim(2, 0.75).Pixdim(3, 2);
  return bytes.Quaternion(3, 5).Quaternion(4, 6).Quaternion(5, 7);
}

TEST_P(NiftiHeader, Qform) {
  NiftiBytes bytes = Bytes();
  const ImageGeometry geometry = PutQform(bytes).Parse().geometry;
  Mat3 direction;  // the columns were (0,1,0), (-1,0,0), (0,0,1) in RAS
  direction << 0, 1, 0, -1, 0, 0, 0, 0, 1;
  EXPECT_TRUE(geometry.direction.isApprox(direction, 1e-6)) << geometry.direction;
  EXPECT_TRUE(geometry.spacing_mm.isApprox(Vec3(0.5, 0.75, 2)));
  EXPECT_TRUE(geometry.origin_W_mm.isApprox(Vec3(-5, -6, 7)));
  direction.col(2) *= -1;
  EXPECT_TRUE(bytes.Pixdim(0, -1).Parse().geometry.direction.isApprox(direction, 1e-6));
}

TEST_P(NiftiHeader, Sform) {
  NiftiBytes bytes = Bytes();
  const ImageGeometry geometry = PutSform(bytes, 2).Parse().geometry;
  Mat3 direction;
  direction << 0, 0, -1, -1, 0, 0, 0, 1, 0;
  EXPECT_TRUE(geometry.direction.isApprox(direction)) << geometry.direction;
  EXPECT_TRUE(geometry.spacing_mm.isApprox(Vec3(0.5, 0.25, 3)));
  EXPECT_TRUE(geometry.origin_W_mm.isApprox(Vec3(-10, -20, 30)));
}

// As nibabel has it.
TEST_P(NiftiHeader, TheSformComesBeforeTheQform) {
  const auto origin = [this](int qform_code, int sform_code) {
    NiftiBytes bytes = Bytes();
    PutSform(PutQform(bytes), sform_code).Qform(qform_code);
    return bytes.Parse().geometry.origin_W_mm;
  };
  const Vec3 qform(-5, -6, 7);
  const Vec3 sform(-10, -20, 30);
  for (const int code : {1, 2, 4}) EXPECT_TRUE(origin(1, code).isApprox(sform)) << code;
  EXPECT_TRUE(origin(0, 4).isApprox(sform));
  EXPECT_TRUE(origin(2, 0).isApprox(qform));
}

// Voxels of 2 x 3 x 4 mm along RAS in both forms. The volume has 20 x 11 x 9 voxels.
NiftiBytes& PutStraight(NiftiBytes& bytes) {
  bytes.Qform(1).Sform(1).Pixdim(0, 1).Pixdim(1, 2).Pixdim(2, 3).Pixdim(3, 4);
  return bytes.Srow(0, 2).Srow(5, 3).Srow(10, 4);
}

TEST_P(NiftiHeader, FormsThatDisagreeAreSaidWithTheAmount) {
  NiftiBytes bytes = Bytes();
  EXPECT_EQ(Parsed(PutStraight(bytes)).all, "");
  bytes.Srow(3, 0.9);  // less than half a voxel to the side
  EXPECT_EQ(Parsed(bytes).all, "");
  bytes.Srow(3, 1.1);
  EXPECT_NE(Parsed(bytes).all.find(" 1.1 mm"), std::string::npos) << Parsed(bytes).all;
  EXPECT_EQ(Parsed(bytes, NiftiForm::kSform).all, "");
  EXPECT_EQ(Parsed(bytes, NiftiForm::kQform).all, "");
  EXPECT_TRUE(Parsed(bytes, NiftiForm::kQform).geometry.origin_W_mm.isZero());
  bytes.Srow(3, 38).Srow(0, -2);  // the same box, mirrored: its corners change places
  EXPECT_NE(Parsed(bytes).all.find(" 38 mm"), std::string::npos) << Parsed(bytes).all;
  EXPECT_NE(Parsed(bytes).all.find("mirror"), std::string::npos) << Parsed(bytes).all;
  EXPECT_TRUE(Parsed(bytes).geometry.direction.col(0).isApprox(Vec3(1, 0, 0)));
}

TEST_P(NiftiHeader, SpacingsThatDisagreeAreSaidWithTheAmount) {
  NiftiBytes bytes = Bytes();
  PutStraight(bytes).Qform(0).Pixdim(3, 4.03);
  EXPECT_EQ(Parsed(bytes).all, "");
  bytes.Pixdim(3, 4.25);
  EXPECT_NE(Parsed(bytes).all.find(" 0.25 mm"), std::string::npos) << Parsed(bytes).all;
  EXPECT_TRUE(Parsed(bytes).geometry.spacing_mm.isApprox(Vec3(2, 3, 4)));
  bytes.Units(3);
  EXPECT_NE(Parsed(bytes).all.find(" 0.00025 mm"), std::string::npos) << Parsed(bytes).all;
}

TEST_P(NiftiHeader, AShearedSformIsStraightenedOrRefused) {
  const auto shear = [this](double mm_per_slice) {
    NiftiBytes bytes = Bytes();
    PutStraight(bytes).Qform(0).Srow(6, mm_per_slice);  // y moves with z
    return bytes;
  };
  const auto is_straight = [](const ImageGeometry& geometry) {
    return (geometry.direction.transpose() * geometry.direction).isIdentity(1e-12);
  };
  // Each of two axes turns by half the angle, and half the slices lie on each side of the middle.
  // So 0.1 mm a slice are 8 x 0.1 / 4 = 0.2 mm, in voxels of 3 mm.
  EXPECT_EQ(Parsed(shear(0.1)).all, "");
  EXPECT_TRUE(is_straight(Parsed(shear(0.1)).geometry));
  EXPECT_NE(Parsed(shear(0.5)).all.find("sheared"), std::string::npos);
  EXPECT_TRUE(is_straight(Parsed(shear(0.5)).geometry));
  // The middle stays: (19, 10, 8) / 2.
  const ImageGeometry straight = Parsed(shear(0.5)).geometry;
  const Vec3 middle =
      straight.origin_W_mm + straight.direction * straight.spacing_mm.cwiseProduct(Vec3(9.5, 5, 4));
  EXPECT_TRUE(middle.isApprox(Vec3(-19, -17, 16), 1e-6)) << middle.transpose();

  NiftiBytes tilt = shear(1.2);
  EXPECT_NE(Refusal([&] { tilt.Parse(); }).find("sheared"), std::string::npos);
  EXPECT_NE(Refusal([&] { tilt.Qform(1).Parse(); }).find("sheared"), std::string::npos);
  EXPECT_EQ(Parsed(tilt, NiftiForm::kQform).all, "");
  EXPECT_TRUE(is_straight(Parsed(tilt, NiftiForm::kSform).geometry));
  EXPECT_NE(Parsed(tilt, NiftiForm::kSform).all.find("sheared"), std::string::npos);
}

TEST_P(NiftiHeader, WithoutAFormTheSidesAreUnknown) {
  NiftiBytes bytes = Bytes();
  PutStraight(bytes).Srow(3, 50);
  EXPECT_TRUE(Parsed(bytes).geometry.is_lps);
  EXPECT_TRUE(Parsed(bytes.Sform(0)).geometry.is_lps);
  const Said said = Parsed(bytes.Qform(0));
  EXPECT_FALSE(said.geometry.is_lps);
  EXPECT_NE(said.all.find("unknown"), std::string::npos);
  EXPECT_TRUE(said.geometry.spacing_mm.isApprox(Vec3(2, 3, 4)));
  EXPECT_TRUE(said.geometry.direction.isIdentity());
  EXPECT_EQ(Parsed(bytes, NiftiForm::kNone).all, "");
  EXPECT_FALSE(Parsed(bytes.Sform(1), NiftiForm::kNone).geometry.is_lps);
  // What the file does not state cannot be chosen.
  EXPECT_NE(Refusal([&] { bytes.Sform(0).Parse(NiftiForm::kSform); }), "");
  EXPECT_NE(Refusal([&] { bytes.Parse(NiftiForm::kQform); }), "");
}

TEST_P(NiftiHeader, Units) {
  const std::pair<int, double> units[] = {{0, 1},    {1, 1e3},   {2, 1},
                                          {3, 1e-3}, {2 + 8, 1}, {3 + 16, 1e-3}};
  for (const auto& [code, mm] : units) {
    NiftiBytes bytes = Bytes();
    const ImageGeometry geometry = PutSform(bytes, 1).Units(code).Parse().geometry;
    EXPECT_TRUE(geometry.spacing_mm.isApprox(mm * Vec3(0.5, 0.25, 3))) << code;
    EXPECT_TRUE(geometry.origin_W_mm.isApprox(mm * Vec3(-10, -20, 30))) << code;
  }
  for (const int code : {4, 5, 6, 7}) {
    NiftiBytes bytes = Bytes();
    EXPECT_NE(PutSform(bytes, 1).Units(code).Parse().geometry.unknown_unit, "") << code;
  }
}

TEST_P(NiftiHeader, AttacksAreRefused) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<std::function<void(NiftiBytes*)>> attacks = {
      [](auto* b) { b->bytes()[0] ^= 1, b->bytes()[3] ^= 1; },
      [](auto* b) { b->Magic("nx"); },
      [](auto* b) { b->Magic("ni"); },
      [](auto* b) { b->Dim(0, 0); },
      [](auto* b) { b->Dim(0, 8); },
      [](auto* b) { b->Dim(0, -1); },
      [](auto* b) { b->Dim(0, 2); },
      [](auto* b) { b->Dim(1, -20); },
      [](auto* b) { b->Dim(2, 0); },
      [](auto* b) { b->Dim(3, 1); },
      [](auto* b) { b->Type(128, 24); },
      [](auto* b) { b->Type(32, 64); },
      [](auto* b) { b->Type(1024, 64); },
      [](auto* b) { b->Type(999, 16); },
      [](auto* b) { b->Pixdim(1, 0.0); },
      [nan](auto* b) { b->Pixdim(3, nan); },
      [](auto* b) { b->Offset(0); },
      [](auto* b) { b->Offset(-352); },
      [](auto* b) { b->Offset(348); },
      [](auto* b) { b->Offset(1e18); },
      [nan](auto* b) { b->Qform(1).Quaternion(0, nan); },
  };
  for (std::size_t k = 0; k < attacks.size(); ++k) {
    NiftiBytes bytes = Bytes();
    attacks[k](&bytes);
    EXPECT_NE(Refusal([&] { bytes.Parse(); }), "") << k;
  }
}

// What a version-1 header cannot say: sizes that overflow.
TEST(Nifti2Header, HugeSizesAreOverTheLimit) {
  const std::int64_t huge = std::numeric_limits<std::int64_t>::max();
  for (const bool swap : {false, true}) {
    NiftiBytes bytes(2, swap);
    bytes.Dim(1, huge).Dim(2, huge).Dim(3, 3);
    const ImageHeader header = bytes.Parse();
    EXPECT_EQ(header.size, (Size{huge, huge, 3}));
    EXPECT_NE(
        Refusal([&] { CheckedVoxelBytes(header.size, ScalarType::kInt16, LeafType::kInt16, {}); }),
        "");
    EXPECT_NE(Refusal([&] { NiftiBytes(2, swap).Dim(0, 4).Dim(4, huge).Parse(); }), "");
  }
  EXPECT_NE(Refusal([] { NiftiBytes(1, false).Offset(352.5).Parse(); }), "");
  std::string damaged = NiftiBytes(2, false).bytes();
  damaged[8] = '\n';  // as after a transfer in text mode
  EXPECT_NE(Refusal([&] { ParseNiftiHeader(damaged); }), "");
}

// In metres, what fits a double need not fit in millimetres.
TEST(Nifti2Header, LengthsThatOverflowInMillimetresAreRefused) {
  EXPECT_NE(Refusal([] { NiftiBytes(2, false).Units(1).Pixdim(2, 1e307).Parse(); }), "");
  NiftiBytes far(2, false);
  far.Units(1).Qform(1).Quaternion(4, 1e307);
  EXPECT_NE(Refusal([&] { far.Parse(); }), "");
  // Likewise what vanishes.
  EXPECT_NE(Refusal([] { NiftiBytes(2, false).Units(3).Pixdim(1, 5e-324).Parse(); }), "");
}

TEST_P(NiftiHeader, EveryPrefixIsRefused) {
  const std::string whole = Bytes().bytes();
  for (std::size_t length = 0; length < whole.size(); ++length) {
    EXPECT_NE(Refusal([&] { ParseNiftiHeader(whole.substr(0, length)); }), "") << length;
  }
}

}  // namespace
}  // namespace palpate
