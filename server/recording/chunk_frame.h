// The bytes of a recording around its chunks.
//
//   file   = header chunk*
//   header = magic[8] version:u32 program_size:u32 created_unix_ns:i64 program
//            created_monotonic_ns:i64 checksum:u64
//   chunk  = checksum:u64 number:u64 type:u16 flags:u16 raw_bytes:u32 stored_bytes:u32 payload
//
// Little endian. Before version 6, created_monotonic_ns is absent. A checksum is XXH3 (64 bits) of
// all other bytes of its header or chunk. Numbers count up from 0; flags are 0. The payload has
// stored_bytes bytes; unpacked by zstd, it has raw_bytes bytes. We use zstd because, of the packers
// in Debian, it alone makes samples small and needs only microseconds per tick. Lengths are checked
// against limits before anything is allocated for them.
//
// Threads: any. Not for real-time code.
#pragma once

#include <cstdint>
#include <istream>
#include <string>
#include <string_view>

#include "server/recording/recording.h"

namespace palpate {

// The version that is written. A later version stores more than an earlier one; all versions from
// the oldest one on are read.
inline constexpr std::uint32_t kRecordingVersion = 6;
inline constexpr std::uint32_t kOldestRecordingVersion = 2;
// The first bytes of every recording.
inline constexpr std::string_view kRecordingMagic = "\x89PLPREC\n";
inline constexpr std::size_t kMaxPayloadBytes = std::size_t{16} << 20;
inline constexpr std::size_t kMaxProgramBytes = 256;

enum class ChunkType : std::uint16_t {
  kSamples = 1,
  kScene,
  kEdit,
  kMarker,
  kGap,
  kKeyframe,
  kEnd,
};

struct Payload {
  ChunkType type{};
  std::string bytes{};
};

// Without created_monotonic_ns, writes the header of version 5.
std::string FrameHeader(const RecordingHeader& header);
// Throws kTooLarge for a payload above kMaxPayloadBytes.
std::string FrameChunk(const Payload& payload, std::uint64_t number);

// Throws Error(kInvalidArgument) if the stream is not a recording, has another version or a damaged
// header. The message names `file`.
RecordingHeader ReadHeader(std::istream& stream, const std::string& file);

// Returns false at the end of the stream. Throws DamagedBytes if the chunk is cut, is damaged, or
// does not have the number `number`.
bool ReadChunk(std::istream& stream, std::uint64_t number, Payload& payload);

}  // namespace palpate
