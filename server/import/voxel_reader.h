// Reads the voxels of one frame, in the type of ReadType().
//
// Threads: one. Reads files. Errors: palpate::Error without the file's name.
#pragma once

#include <zlib.h>

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <vector>

#include "server/import/image_header.h"

namespace palpate {

// Inflates a part of a file. Detects gzip (also several members in a row) or zlib from the data.
//
// Threads: one. Reads the given file. Errors: palpate::Error for truncated and damaged data,
// std::bad_alloc.
class Inflater {
 public:
  // Inflates `length` bytes of the file from `begin` on. `in` must outlive this object.
  Inflater(std::ifstream* in, std::int64_t begin, std::int64_t length);
  ~Inflater();
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  // Fills `out` as far as data exist, and returns the number of bytes.
  std::size_t Read(char* out, std::size_t count);

 private:
  bool Refill();
  bool StartNextMember();

  std::ifstream* in_;
  std::int64_t left_;
  std::vector<char> input_;
  z_stream stream_{};
  bool ended_ = false;
};

// Takes a volume's voxels part by part, x fastest. All parts are of one type. `voxels` is aligned
// for the type and valid during the call.
using VoxelSink = std::function<void(LeafType type, const void* voxels, std::size_t count)>;

// What a VoxelSink gets, as floats.
inline std::vector<float> FloatsOf(LeafType type, const void* voxels, std::size_t count) {
  return VisitType(type, [&](auto voxel) {
    const auto* const first = static_cast<const decltype(voxel)*>(voxels);
    return std::vector<float>(first, first + count);
  });
}

// Converts `count` voxels at `bytes` to voxels of ReadType(header) at `out`, with the header's
// type, byte order, slope and intercept.
void DecodeVoxels(const char* bytes, std::size_t count, const ImageHeader& header, void* out);

// Reads a file that ReadCheckedHeader() accepted with this header. `frame` must exist. Memory: two
// small buffers. Refuses a file that has changed since the check.
void ReadVoxels(const std::filesystem::path& path, const ImageHeader& header, std::int64_t frame,
                const VoxelSink& sink);

}  // namespace palpate
