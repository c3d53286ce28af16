// The volume as browsers fetch it, against plain arrays: groups voxel by voxel, names, overview,
// manifests, and how long superseded blobs stay.
#include <gtest/gtest.h>
#include <xxhash.h>
#include <zlib.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "client/web/volume/blob.h"
#include "client/web/volume/grouped_volume.h"
#include "common/bricks/zstd_codec.h"
#include "tests/support/plain_volume.h"

namespace palpate::web {
namespace {

using Time = GroupedVolume::Time;
using nlohmann::json;

std::string Unzip(const std::string& gzip, std::size_t size) {
  std::string bytes(size + 1, '\0');
  z_stream stream{};
  inflateInit2(&stream, 31);
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(gzip.data()));
  stream.avail_in = static_cast<uInt>(gzip.size());
  stream.next_out = reinterpret_cast<Bytef*>(bytes.data());
  stream.avail_out = static_cast<uInt>(bytes.size());
  EXPECT_EQ(inflate(&stream, Z_FINISH), Z_STREAM_END);
  bytes.resize(stream.total_out);
  inflateEnd(&stream);
  return bytes;
}

void ExpectHolds(const Blob& blob, const std::string& bytes) {
  EXPECT_EQ(*blob.Encoded(Encoding::kIdentity), bytes);
  std::string unzipped(bytes.size(), '\0');
  Decompress(*blob.Encoded(Encoding::kZstd), std::span(unzipped));
  EXPECT_EQ(unzipped, bytes);
  EXPECT_EQ(Unzip(*blob.Encoded(Encoding::kGzip), bytes.size()), bytes);
}

std::string Decode64(const std::string& text) {
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  unsigned held = 0;
  int bits = 0;
  for (const char c : text) {
    if (c == '=') break;
    held = held << 6 | static_cast<unsigned>(digits.find(c));
    if ((bits += 6) < 8) continue;
    bits -= 8;
    bytes += static_cast<char>(held >> bits & 255);
  }
  return bytes;
}

std::string HexOf(const std::string& bytes) {
  std::string hex;
  for (const char c : bytes) {
    char two[3];
    std::snprintf(two, sizeof two, "%02x", static_cast<unsigned char>(c));
    hex += two;
  }
  return hex;
}

std::string NameFor(unsigned char kind, const std::string& bytes) {
  const std::string all = std::string(1, static_cast<char>(kind)) + bytes;
  const XXH128_hash_t hash = XXH3_128bits(all.data(), all.size());
  char name[33];
  std::snprintf(name, sizeof name, "%016llx%016llx", static_cast<unsigned long long>(hash.high64),
                static_cast<unsigned long long>(hash.low64));
  return name;
}

template <class T>
void Append(std::string& bytes, T value) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

std::string PlainGroup(const PlainVolume& plain, const Vec3i& group, LeafType type) {
  std::string bytes;
  VisitType(type, [&](auto voxel) {
    for (int n = 0; n < 32 * 32 * 32; ++n) {
      const Vec3i at = group * 32 + Vec3i(n / 1024, n / 32 % 32, n % 32);
      Append(bytes, static_cast<decltype(voxel)>(plain.Value(at)));
    }
  });
  return bytes;
}

double PlainMean(const PlainVolume& plain, const Vec3i& block, int factor) {
  double sum = 0.0;
  int count = 0;
  for (int i = block.x() * factor; i < std::min(plain.size().x(), (block.x() + 1) * factor); ++i) {
    for (int j = block.y() * factor; j < std::min(plain.size().y(), (block.y() + 1) * factor);
         ++j) {
      for (int k = block.z() * factor; k < std::min(plain.size().z(), (block.z() + 1) * factor);
           ++k, ++count) {
        sum += static_cast<double>(plain.Value({i, j, k}));
      }
    }
  }
  return sum / count;
}

void JudgeOverview(const GroupedVolume& volume, const json& overview, const PlainVolume& plain,
                   LeafType type, int factor = 1) {
  while ((plain.size().maxCoeff() + factor - 1) / factor > 128) factor *= 2;
  ASSERT_EQ(overview["factor"], factor);
  const auto size = overview["size"].get<std::vector<int>>();
  const BlobPtr blob = volume.Find(overview["name"].get<std::string>());
  ASSERT_TRUE(blob);
  const std::string bytes = *blob->Encoded(Encoding::kIdentity);
  EXPECT_EQ(NameFor(static_cast<unsigned char>(type), bytes), blob->name());
  std::size_t at = 0;
  for (int axis = 0; axis < 3; ++axis) {
    ASSERT_EQ(size[static_cast<std::size_t>(axis)], (plain.size()[axis] + factor - 1) / factor);
  }
  VisitType(type, [&](auto voxel) {
    using T = decltype(voxel);
    ASSERT_EQ(bytes.size(), sizeof(T) * size[0] * size[1] * size[2]);
    for (int i = 0; i < size[0]; ++i) {
      for (int j = 0; j < size[1]; ++j) {
        for (int k = 0; k < size[2]; ++k, at += sizeof(T)) {
          T held;
          std::memcpy(&held, &bytes[at], sizeof(T));
          const double mean = PlainMean(plain, {i, j, k}, factor);
          if constexpr (std::is_integral_v<T>) {
            ASSERT_EQ(static_cast<double>(held), std::round(mean));
          } else {
            ASSERT_NEAR(held, mean, 1e-6 * (1.0 + std::abs(mean)));
          }
        }
      }
    }
  });
}

// The names of the groups that the manifest names.
std::set<std::string> Judge(const GroupedVolume& volume, const ManifestInfo& info,
                            const PlainVolume& plain) {
  std::set<std::string> names;
  const BlobPtr blob = volume.Find(info.name);
  EXPECT_TRUE(blob);
  if (!blob) return names;
  EXPECT_EQ(blob->content_type(), "application/json");
  const std::string text = *blob->Encoded(Encoding::kIdentity);
  EXPECT_EQ(NameFor(255, text), info.name);
  const json manifest = json::parse(text);
  const LeafType type = plain.Type();
  EXPECT_EQ(manifest["lattice"]["voxel_type"], Name(type));
  EXPECT_EQ(manifest["lattice"]["background"].get<float>(), plain.background());
  EXPECT_EQ(manifest["revision"], info.revision.volume_revision);
  EXPECT_EQ(manifest["daemon_id"], "7");
  char hash[33];
  std::snprintf(hash, sizeof hash, "%016llx0000000000000005",
                static_cast<unsigned long long>(info.revision.volume_revision));
  EXPECT_EQ(manifest["content_hash"], hash);
  const std::string listed = Decode64(manifest["groups"].get<std::string>());
  const Vec3i count = (plain.size() + Vec3i::Constant(31)) / 32;
  EXPECT_EQ(listed.size(), 16u * count.prod());
  std::size_t at = 0;
  for (int a = 0; a < count.x(); ++a) {
    for (int b = 0; b < count.y(); ++b) {
      for (int c = 0; c < count.z(); ++c, at += 16) {
        const std::string bytes = PlainGroup(plain, {a, b, c}, type);
        const std::string name = HexOf(listed.substr(at, 16));
        if (AreAll(bytes, type, plain.background())) {
          EXPECT_EQ(name, std::string(32, '0'));
          continue;
        }
        EXPECT_EQ(name, NameFor(static_cast<unsigned char>(type), bytes));
        const BlobPtr group = volume.Find(name);
        EXPECT_TRUE(group);
        if (group && names.insert(name).second) ExpectHolds(*group, bytes);
      }
    }
  }
  JudgeOverview(volume, manifest["overview"], plain, type);
  return names;
}

float RandomValue(LeafType type, std::mt19937& random) {
  switch (type) {
    case LeafType::kUint8:
      return static_cast<float>(random() % 256);
    case LeafType::kInt16:
      return static_cast<float>(random() % 65536) - 32768.0f;
    case LeafType::kUint16:
      return static_cast<float>(random() % 65536);
    case LeafType::kFloat:
      break;
  }
  return static_cast<float>(random()) * 1e-6f - 2000.0f;
}

void EditBrick(PlainVolume& plain, LeafType type, std::mt19937& random) {
  const std::uint64_t number = random() % plain.bricks();
  const Vec3i end = (BrickWithNumber(number, plain.lattice().BrickCounts()) + Vec3i::Ones()) * 8;
  const bool is_within = (end.array() <= plain.size().array()).all();
  switch (random() % 5) {
    case 0:  // background, voxel by voxel
      plain.SetBrick(number, type, [&] { return plain.background(); });
      break;
    case 1:
      plain.SetConstant(number, type, plain.background());
      break;
    case 2:
      if (is_within) plain.SetConstant(number, type, RandomValue(type, random));
      break;
    default:
      plain.SetBrick(number, type, [&] { return RandomValue(type, random); });
  }
}

class Volumes : public testing::TestWithParam<LeafType> {};
INSTANTIATE_TEST_SUITE_P(All, Volumes, testing::ValuesIn(kLeafTypes),
                         [](const auto& given) { return std::string(Name(given.param)); });

TEST_P(Volumes, GroupsOverviewAndNamesAreThoseOfThePlainVoxels) {
  std::mt19937 random(23);
  const Vec3i sizes[] = {{1, 1, 1},    {32, 32, 32}, {33, 70, 5},  {64, 64, 64},
                         {200, 9, 45}, {8, 40, 300}, {3, 4100, 20}};
  for (const Vec3i& size : sizes) {
    SCOPED_TRACE(size.transpose());
    PlainVolume plain(size, GetParam(), 7.0f);
    GroupedVolume volume(true);
    for (int n = 0; n < 6; ++n) {
      const std::uint64_t edits = n == 0 ? plain.bricks() / 2 : random() % 4;
      for (std::uint64_t m = 0; m < edits; ++m) EditBrick(plain, GetParam(), random);
      // Floats in a volume of integers, and back.
      const std::uint64_t mixed = plain.bricks() / 2;
      if (n == 3) plain.SetBrick(mixed, LeafType::kFloat, [] { return 0.5f; });
      if (n == 4) plain.SetBrick(mixed, GetParam(), [] { return 9.0f; });
      const auto info = volume.Apply(plain.Take(), Time());
      ASSERT_TRUE(info);
      Judge(volume, *info, plain);
    }
  }
}

TEST(GroupedVolume, ABackgroundThatTheTypeDoesNotHold) {
  std::mt19937 random(5);
  PlainVolume plain({40, 9, 9}, LeafType::kUint8, -1000.5f);
  plain.SetBrick(0, LeafType::kUint8, [&] { return RandomValue(LeafType::kUint8, random); });
  GroupedVolume volume(true);
  const auto info = volume.Apply(plain.Take(), Time());
  ASSERT_TRUE(info);
  EXPECT_EQ(Judge(volume, *info, plain).size(), 1u);
}

TEST(GroupedVolume, ConstantAndEqualGroupsAreOneBlob) {
  PlainVolume plain({100, 64, 64}, LeafType::kUint8, 0.0f);
  plain.Fill({0, 12 * 8 * 8}, LeafType::kUint8, 3.0f);
  GroupedVolume volume(true);
  const auto info = volume.Apply(plain.Take(), Time());
  ASSERT_TRUE(info);
  EXPECT_EQ(Judge(volume, *info, plain).size(), 1u);
  EXPECT_EQ(volume.shelf().size(), 3u);  // with overview and manifest
}

// Far too large for memory if anything but the map's blocks were looked at.
TEST(GroupedVolume, ALargeSparseVolume) {
  client::VolumeUpdate update;
  update.all = true;
  update.lattice.emplace();
  update.lattice->size = Vec3i::Constant(2048);
  update.lattice->type = LeafType::kUint8;
  BrickMap map(update.lattice->BrickCounts(), TypedBrick::Constant(LeafType::kUint8, 0.0f));
  const TypedBrickPtr one = TypedBrick::Constant(LeafType::kUint8, 1.0f);
  map.Fill({0, std::uint64_t{64} * 256 * 256}, one);
  map.Put(map.size() - 1, one);
  update.bricks = map.Share();
  update.complete = VolumeRevision{1, 1};
  GroupedVolume volume(true);
  const auto info = volume.Apply(update, Time());
  ASSERT_TRUE(info);
  EXPECT_EQ(volume.shelf().size(), 4u);  // two groups, overview, manifest
  const json manifest = json::parse(*volume.Find(info->name)->Encoded(Encoding::kIdentity));
  const std::string groups = Decode64(manifest["groups"].get<std::string>());
  ASSERT_EQ(groups.size(), std::size_t{16} * 64 * 64 * 64);
  const auto zeros = [&](std::size_t group) {
    return groups.substr(16 * group, 16) == std::string(16, '\0');
  };
  EXPECT_FALSE(zeros(0) || zeros(16 * 64 * 64 - 1) || zeros(64 * 64 * 64 - 1));
  EXPECT_TRUE(zeros(16 * 64 * 64) && zeros(64 * 64 * 64 - 2));
}

TEST(GroupedVolume, WithoutGroupsThereIsTheOverviewAlone) {
  std::mt19937 random(3);
  PlainVolume plain({150, 40, 40}, LeafType::kUint8, 0.0f);
  GroupedVolume volume(false);
  for (int n = 0; n < 3; ++n) {
    for (int m = 0; m < 20; ++m) EditBrick(plain, LeafType::kUint8, random);
    const auto info = volume.Apply(plain.Take(), Time());
    ASSERT_TRUE(info);
    const json manifest = json::parse(*volume.Find(info->name)->Encoded(Encoding::kIdentity));
    EXPECT_EQ(manifest["groups"], "");
    JudgeOverview(volume, manifest["overview"], plain, LeafType::kUint8, 4);
  }
  EXPECT_EQ(volume.Find(NameFor(0, PlainGroup(plain, {0, 0, 0}, LeafType::kUint8))), nullptr);
}

TEST(GroupedVolume, OnlyCompleteCopiesAreAnnounced) {
  std::mt19937 random(9);
  PlainVolume plain({64, 64, 64}, LeafType::kInt16, 0.0f);
  GroupedVolume volume(true);
  const auto partly = [&] {
    for (int m = 0; m < 9; ++m) EditBrick(plain, LeafType::kInt16, random);
    client::VolumeUpdate update = plain.Take();
    update.complete.reset();
    return update;
  };
  EXPECT_FALSE(volume.Apply(partly(), Time()));
  EXPECT_FALSE(volume.Apply(partly(), Time()));
  const auto first = volume.Apply(plain.Take(), Time());
  ASSERT_TRUE(first);
  Judge(volume, *first, plain);
  EXPECT_FALSE(volume.Apply(partly(), Time()));
  const auto second = volume.Apply(plain.Take(), Time());
  ASSERT_TRUE(second);
  Judge(volume, *second, plain);

  client::VolumeUpdate same = plain.Take();
  same.complete = second->revision;
  EXPECT_FALSE(volume.Apply(same, Time())) << "nothing is new";
}

TEST(GroupedVolume, TheLastVolumeStaysUntilTheNextIsComplete) {
  std::mt19937 random(2);
  PlainVolume plain({40, 40, 40}, LeafType::kUint8, 0.0f);
  for (int m = 0; m < 20; ++m) EditBrick(plain, LeafType::kUint8, random);
  GroupedVolume volume(true);
  const auto info = volume.Apply(plain.Take(), Time());
  ASSERT_TRUE(info);

  client::VolumeUpdate lost;
  lost.all = true;
  EXPECT_FALSE(volume.Apply(lost, Time() + std::chrono::hours(1)));
  PlainVolume other({9, 70, 9}, LeafType::kFloat, 1.5f);
  client::VolumeUpdate begun = other.Take();
  begun.complete.reset();
  EXPECT_FALSE(volume.Apply(begun, Time() + std::chrono::hours(2)));
  Judge(volume, *info, plain);

  other.SetBrick(2, LeafType::kFloat, [] { return 0.25f; });
  const auto next = volume.Apply(other.Take(), Time() + std::chrono::hours(2));
  ASSERT_TRUE(next);
  Judge(volume, *next, other);
  Judge(volume, *info, plain);  // superseded just now
  volume.Expire(Time() + std::chrono::hours(3));
  EXPECT_EQ(volume.Find(info->name), nullptr);
  Judge(volume, *next, other);
  EXPECT_EQ(volume.shelf().superseded_bytes(), 0u);
}

TEST(GroupedVolume, EditsKeepSupersededGroupsAndTwoSupersededOverviews) {
  std::mt19937 random(4);
  PlainVolume plain({64, 64, 64}, LeafType::kUint8, 0.0f);
  GroupedVolume volume(true);
  std::vector<std::string> overviews;
  std::set<std::string> groups;
  for (int n = 0; n < 6; ++n) {
    plain.SetBrick(n, LeafType::kUint8, [&] { return RandomValue(LeafType::kUint8, random); });
    const auto info = volume.Apply(plain.Take(), Time());
    ASSERT_TRUE(info);
    groups.merge(Judge(volume, *info, plain));
    const json manifest = json::parse(*volume.Find(info->name)->Encoded(Encoding::kIdentity));
    overviews.push_back(manifest["overview"]["name"]);
  }
  for (std::size_t n = 0; n < overviews.size(); ++n) {
    EXPECT_EQ(volume.Find(overviews[n]) != nullptr, n >= 3) << n;
  }
  EXPECT_EQ(groups.size(), 6u);
  for (const std::string& group : groups) EXPECT_TRUE(volume.Find(group));
}

TEST(GroupedVolume, OverviewAndManifestAreCompressedWhenAnnounced) {
  PlainVolume plain({9, 9, 9}, LeafType::kUint8, 0.0f);
  GroupedVolume volume(false);
  const auto info = volume.Apply(plain.Take(), Time());
  ASSERT_TRUE(info);
  const std::size_t before = Blob::kept_bytes();
  const BlobPtr manifest = volume.Find(info->name);
  const json text = json::parse(*manifest->Encoded(Encoding::kIdentity));
  manifest->Encoded(Encoding::kZstd);
  volume.Find(text["overview"]["name"].get<std::string>())->Encoded(Encoding::kZstd);
  EXPECT_EQ(Blob::kept_bytes(), before);
}

TEST(GroupedVolume, AfterAFailureTheLastManifestStaysAndTheNextUpdateMakesAllAnew) {
  std::mt19937 random(6);
  PlainVolume plain({64, 40, 40}, LeafType::kUint8, 0.0f);
  const auto edit = [&] {
    for (int m = 0; m < 9; ++m) EditBrick(plain, LeafType::kUint8, random);
  };
  edit();
  GroupedVolume volume(true);
  const auto first = volume.Apply(plain.Take(), Time());
  ASSERT_TRUE(first);
  const std::set<std::string> groups = Judge(volume, *first, plain);
  edit();
  client::VolumeUpdate impossible = plain.Take();  // more groups than a vector may have
  impossible.all = true;
  impossible.lattice->size = {1 << 30, 1 << 30, 1 << 15};
  for (int n = 0; n < 2; ++n) EXPECT_ANY_THROW(volume.Apply(impossible, Time()));
  EXPECT_TRUE(volume.Find(first->name));
  for (const std::string& group : groups) EXPECT_TRUE(volume.Find(group));
  edit();
  client::VolumeUpdate next = plain.Take();
  ASSERT_FALSE(next.all);
  const auto second = volume.Apply(next, Time());
  ASSERT_TRUE(second);
  Judge(volume, *second, plain);
}

ContentHash HashNumber(std::uint64_t n) { return {n, n * 3}; }

void Use(BlobShelf& shelf, std::uint64_t n, std::size_t bytes) {
  shelf.Use(HashNumber(n), bytes, [n] {
    return std::make_shared<Blob>(NameOf(HashNumber(n)), "application/json",
                                  [] { return std::string("{}"); });
  });
}

bool Holds(const BlobShelf& shelf, std::uint64_t n) {
  return shelf.Find(NameOf(HashNumber(n))) != nullptr;
}

TEST(BlobShelf, SupersededBlobsStayForAWhile) {
  BlobShelf shelf;
  const auto at = [](int ms) { return Time() + std::chrono::milliseconds(ms); };
  Use(shelf, 1, 100);
  Use(shelf, 1, 100);
  Use(shelf, 2, 100);
  shelf.Release(HashNumber(1), at(0));
  shelf.Expire(at(100000));
  EXPECT_TRUE(Holds(shelf, 1)) << "still in use once";
  shelf.Release(HashNumber(1), at(0));
  shelf.Release(HashNumber(2), at(1000));
  shelf.Expire(at(9999));
  EXPECT_TRUE(Holds(shelf, 1) && Holds(shelf, 2));
  Use(shelf, 1, 100);  // again in use
  shelf.Expire(at(10500));
  EXPECT_TRUE(Holds(shelf, 1) && Holds(shelf, 2));
  shelf.Release(HashNumber(1), at(10800));
  shelf.Expire(at(11000));
  EXPECT_TRUE(Holds(shelf, 1) && !Holds(shelf, 2));
  EXPECT_EQ(shelf.superseded_bytes(), 100u);
  shelf.Expire(at(20800));
  EXPECT_EQ(shelf.size(), 0u);
  EXPECT_EQ(shelf.superseded_bytes(), 0u);
}

TEST(BlobShelf, SupersededBlobsTakeBoundedMemory) {
  BlobShelf shelf;
  constexpr std::size_t kEach = std::size_t{50} << 20;
  for (std::uint64_t n = 0; n < 20; ++n) {
    Use(shelf, n, kEach);
    shelf.Release(HashNumber(n), Time());
    shelf.Expire(Time());
    ASSERT_LE(shelf.superseded_bytes(), BlobShelf::kMostSupersededBytes);
  }
  EXPECT_EQ(shelf.size(), 5u);
  EXPECT_TRUE(Holds(shelf, 19) && Holds(shelf, 15) && !Holds(shelf, 14));
}

TEST(BlobNames, AreThirtyTwoSmallHexDigits) {
  const ContentHash hash{0x0123456789abcdef, 0xfedcba9876543210};
  EXPECT_EQ(NameOf(hash), "0123456789abcdeffedcba9876543210");
  EXPECT_EQ(ParseName(NameOf(hash)), hash);
  const std::string wrong[] = {"",
                               "0123",
                               NameOf(hash) + "0",
                               std::string(32, 'A'),
                               std::string(31, '0') + "/",
                               std::string(31, '0') + '\0'};
  for (const std::string& name : wrong) EXPECT_FALSE(ParseName(name)) << name;
  for (int size = 0; size < 9; ++size) {
    const std::string bytes = std::string("\xff\0abc\x80xyz", 9).substr(0, size);
    EXPECT_EQ(Decode64(Base64(bytes)), bytes);
    EXPECT_EQ(Base64(bytes).size() % 4, 0u);
  }
}

}  // namespace
}  // namespace palpate::web
