// The field that a ball feels in place of a volume: at each vertex, the greatest value that the
// volume has within the ball around it. A point at the ball's centre that feels this field touches
// every isosurface of the volume as the ball does, whatever the isovalue is: where F >= τ somewhere
// within the ball, and only there, the field is >= τ.
//
// The greatest value is taken over the lines of the lattice within the ball: over its vertices, and
// where the lines of the three axes meet the sphere. (Between them F is linear, so a greatest value
// within a cell can be moved along an axis until it meets a vertex or the sphere.) A small ball has
// few lines: fixed points of the sphere are added. None of this finds too much: the ball is felt a
// little too small on flat parts. Between vertices the field is interpolated, so in a crease it is
// felt up to half a voxel too large. deploy/guides/method.md has the figures.
//
// A stylus that is free above τ touches where the least value is too low: `is_least`.
//
// The field's lattice is larger than the volume's by margin() on each side, so that the ball stops
// before the border's cap. Revisions are the volume's; a brick has the newest of those that its
// values depend on.
//
// Frames: I voxels of the volume, D device (mm). Values in data units.
// Threads: pure; any. Not for real-time code.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "server/volume/snapshot/ball.h"
#include "server/volume/snapshot/snapshot.h"

namespace palpate {

class BallField {
 public:
  explicit BallField(const Ball& ball);

  // The vertices around one that its value depends on, along each axis.
  const Vec3i& reach() const { return reach_; }
  // Whole bricks.
  const Vec3i& margin() const { return margin_; }
  // The lattice's metadata, and its place: vertex v of the field is vertex v - margin() of the
  // volume.
  VolumeMetadata On(const VolumeMetadata& volume) const;
  // The most memory that the field of a volume of this size takes.
  std::uint64_t MostBytes(const Vec3i& size) const;

  // Returns the field of `volume`. `progress` is called with the share that is done, from this
  // thread; what it throws ends the work. Takes up to `threads` threads, which have the priority of
  // the caller's.
  std::shared_ptr<const VolumeSnapshot> Of(const VolumeSnapshot& volume, int threads,
                                           const std::function<void(double share)>& progress) const;

  // Returns the bricks of `field` that differ after the `changed` bricks of its volume have led to
  // `volume`.
  std::vector<BrickChange> ChangesOf(const VolumeSnapshot& volume, const VolumeSnapshot& field,
                                     std::span<const Vec3i> changed, int threads) const;

 private:
  // The parts of the ball's lines that are equal: from `low` to `high` along the axis. An end that
  // is no vertex lies between two; `share` of the second one is its value.
  struct End {
    int vertex = 0;
    float share = 0.0f;
    bool is_between() const { return share > 0.0f; }
  };
  struct Lines {
    End low, high;
    int first = 0, last = -1;                 // the vertices between
    std::vector<std::array<int, 2>> columns;  // of the other two axes
    std::array<int, 2> widest{};              // of them
  };
  struct Point {
    Vec3i vertex;
    std::array<float, 3> share;
  };
  class Tile;

  void AddLines(const Mat3& metric, int axis);
  void AddPoints(const Mat3& index_from_device);

  const Ball ball_;
  std::array<std::vector<Lines>, 3> lines_;  // along x, y, z
  std::vector<Point> points_;
  Vec3i reach_ = Vec3i::Zero(), margin_ = Vec3i::Zero();
};

}  // namespace palpate
