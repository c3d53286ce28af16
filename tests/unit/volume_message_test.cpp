// Events of a volume on the wire and back.
#include "common/wire/volume_message.h"

#include <gtest/gtest.h>

#include "common/error/error.h"
#include "tests/support/refusal.h"

namespace palpate {
namespace {

using testing::Refusal;

VolumeMessage ThereAndBack(const VolumeEvent& event) {
  const std::string bytes = ToProto(VolumeMessage{42, event}).SerializeAsString();
  v1::StreamVolumeResponse message;
  EXPECT_TRUE(message.ParseFromString(bytes));
  VolumeMessage back = FromProto(std::move(message));
  EXPECT_EQ(back.number, 42u);
  EXPECT_EQ(back.event.index(), event.index());
  return back;
}

AffineMap Map() {
  AffineMap map;
  map.linear << 1, 2, 3, 4, 5, 6, 7, 8, 10;
  map.translation = Vec3(-1, 0.5, 1e-9);
  return map;
}

TEST(VolumeMessage, EveryEventComesBackAsItWas) {
  const VolumeMessage a = ThereAndBack(VolumeLattice{.source = "x.nrrd",
                                                     .size = Vec3i(1, 20, 300),
                                                     .spacing_mm = Vec3(0.1, 2, 3),
                                                     .X_WI = Map(),
                                                     .value_min = -1024,
                                                     .value_max = 3071,
                                                     .unit = "HU",
                                                     .loaded_revision = 7});
  const auto& lattice = std::get<VolumeLattice>(a.event);
  EXPECT_EQ(lattice.source, "x.nrrd");
  EXPECT_EQ(lattice.size, Vec3i(1, 20, 300));
  EXPECT_EQ(lattice.spacing_mm, Vec3(0.1, 2, 3));
  EXPECT_EQ(lattice.X_WI.linear, Map().linear);
  EXPECT_EQ(lattice.X_WI.translation, Map().translation);
  EXPECT_EQ(lattice.value_min, -1024);
  EXPECT_EQ(lattice.value_max, 3071);
  EXPECT_EQ(lattice.unit, "HU");
  EXPECT_EQ(lattice.loaded_revision, 7u);

  const VolumeMessage b = ThereAndBack(VolumePlacement{Map(), 11});
  EXPECT_EQ(std::get<VolumePlacement>(b.event).X_DI.linear, Map().linear);
  EXPECT_EQ(std::get<VolumePlacement>(b.event).settings_revision, 11u);

  const std::string bytes("\0\xff zstd", 7);
  const VolumeMessage c = ThereAndBack(VolumeOverview{Vec3i(4, 5, 6), 1ull << 40, bytes});
  EXPECT_EQ(std::get<VolumeOverview>(c.event).size, Vec3i(4, 5, 6));
  EXPECT_EQ(std::get<VolumeOverview>(c.event).first_block, 1ull << 40);
  EXPECT_EQ(std::get<VolumeOverview>(c.event).zstd_values, bytes);

  const VolumeMessage d = ThereAndBack(VolumeBricks{{0, 1, 1ull << 50}, bytes, 99});
  EXPECT_EQ(std::get<VolumeBricks>(d.event).numbers,
            (std::vector<std::uint64_t>{0, 1, 1ull << 50}));
  EXPECT_EQ(std::get<VolumeBricks>(d.event).zstd_values, bytes);
  EXPECT_EQ(std::get<VolumeBricks>(d.event).bricks_left, 99u);

  const VolumeMessage e = ThereAndBack(VolumeComplete{{~0ull, 5}, {~0ull - 1, 3}});
  EXPECT_EQ(std::get<VolumeComplete>(e.event).revision, (VolumeRevision{~0ull, 5}));
  EXPECT_EQ(std::get<VolumeComplete>(e.event).content_hash, (ContentHash{~0ull - 1, 3}));
}

TEST(VolumeMessage, WhatIsNoEventIsRefused) {
  v1::StreamVolumeResponse empty, large, bent;
  large.mutable_lattice()->set_size_y(1u << 31);
  bent.mutable_placement()->mutable_device_from_index()->add_linear(1.0);
  for (const v1::StreamVolumeResponse& bad : {empty, large, bent}) {
    EXPECT_EQ(Refusal([&] { FromProto(bad); }), ErrorKind::kInvalidArgument);
  }
}

}  // namespace
}  // namespace palpate
