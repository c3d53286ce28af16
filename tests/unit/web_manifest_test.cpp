// Manifests read back, blobs of compressed bytes, base64: what a gateway gets from another one.
#include <gtest/gtest.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <span>
#include <string>

#include "client/web/volume/blob.h"
#include "client/web/volume/manifest.h"
#include "common/bricks/zstd_codec.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

using nlohmann::json;

Manifest Example() {
  std::mt19937_64 random(7);
  Manifest manifest;
  manifest.size = {33, 64, 1};
  manifest.type = LeafType::kInt16;
  manifest.overview = {random(), random()};
  for (int n = 0; n < 4; ++n) manifest.groups.push_back({random(), random()});
  manifest.groups[2] = {};
  return manifest;
}

TEST(Manifest, NamesItsBlobs) {
  Manifest written = Example();
  for (const bool has_groups : {true, false}) {
    if (!has_groups) written.groups.clear();
    const Manifest read = ParseManifest(ToJson(written));
    EXPECT_EQ(read.size, written.size);
    EXPECT_EQ(read.type, written.type);
    EXPECT_EQ(read.overview, written.overview);
    EXPECT_EQ(read.groups, written.groups);
  }
}

TEST(Manifest, OthersAreRefused) {
  const json good = json::parse(ToJson(Example()));
  const auto refuses = [](const json& text) {
    try {
      ParseManifest(text.dump());
    } catch (const Error& error) {
      return error.kind() == ErrorKind::kInvalidArgument;
    }
    return false;
  };
  EXPECT_FALSE(refuses(good));
  for (const std::string key : {"lattice", "overview", "groups"}) {
    json without = good;
    without.erase(key);
    EXPECT_TRUE(refuses(without)) << key;
    json other = good;
    other[key] = {{"no", "such"}};
    EXPECT_TRUE(refuses(other)) << key;
  }
  const auto with = [&](const char* pointer, const json& value) {
    json changed = good;
    changed[json::json_pointer(pointer)] = value;
    return changed;
  };
  EXPECT_TRUE(refuses(with("/lattice/size", {33, 64, 0})));
  EXPECT_TRUE(refuses(with("/lattice/size", {33, 64})));
  EXPECT_TRUE(refuses(with("/lattice/size", {33, 64, 33})));  // 8 groups, and 4 are named
  EXPECT_TRUE(refuses(with("/lattice/size", {1 << 30, 1 << 30, 1 << 30})));
  EXPECT_TRUE(refuses(with("/lattice/voxel_type", "int32")));
  EXPECT_TRUE(refuses(with("/overview/name", "0123")));
  EXPECT_TRUE(refuses(with("/overview/name", std::string(32, 'A'))));
  EXPECT_TRUE(refuses(with("/groups", "AAAA")));
  EXPECT_TRUE(refuses(with("/groups", "%$$%")));
  EXPECT_THROW(ParseManifest("{"), Error);
  EXPECT_THROW(ParseManifest(std::string(100'000, '[')), Error);
}

TEST(Base64, IsReadBack) {
  std::mt19937 random(3);
  for (std::size_t size = 0; size < 100; ++size) {
    std::string bytes(size, '\0');
    for (char& byte : bytes) byte = static_cast<char>(random());
    EXPECT_EQ(FromBase64(Base64(bytes)), bytes);
  }
  for (const char* wrong : {"A", "AA", "AAA", "A===", "AA=A", "====", "AA A", "AAAA=AAA"}) {
    EXPECT_THROW(FromBase64(wrong), Error) << wrong;
  }
}

TEST(BlobNames, AreReadBackFromTheirBytes) {
  const ContentHash hash{0x0123456789abcdef, 0xfedcba9876543210};
  const auto bytes = BytesOf(hash);
  EXPECT_EQ(HashOf({bytes.data(), bytes.size()}), hash);
}

TEST(CompressedBlob, KeepsItsBytesAndRefusesWhatIsNone) {
  const std::string bytes(100'000, 'x');
  const auto zstd =
      std::make_shared<const std::string>(CompressBytes(std::as_bytes(std::span(bytes))));
  const std::size_t before = Blob::kept_bytes();
  {
    const Blob blob("name", "application/octet-stream", zstd);
    EXPECT_EQ(blob.Encoded(Encoding::kZstd), zstd);
    EXPECT_EQ(*blob.Encoded(Encoding::kIdentity), bytes);
    EXPECT_EQ(Blob::kept_bytes(), before + zstd->size());
  }
  EXPECT_EQ(Blob::kept_bytes(), before);
  for (const std::string& wrong : {std::string("no zstd"), zstd->substr(0, zstd->size() - 1)}) {
    const Blob blob("name", "application/octet-stream", std::make_shared<const std::string>(wrong));
    EXPECT_THROW(blob.Encoded(Encoding::kIdentity), Error);
  }
}

TEST(CompressedBlob, RefusesABomb) {
  const std::string bytes(Blob::kMostBytes + 1, '\0');
  const auto zstd =
      std::make_shared<const std::string>(CompressBytes(std::as_bytes(std::span(bytes))));
  const Blob blob("name", "application/octet-stream", zstd);
  EXPECT_THROW(blob.Encoded(Encoding::kIdentity), Error);
}

}  // namespace
}  // namespace palpate::web
