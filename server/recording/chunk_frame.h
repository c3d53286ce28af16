// The bytes of a recording around its chunks.
//
//   file   = header chunk*
//   header = magic[8] version:u32 program_size:u32 created_unix_ns:i64 program checksum:u64
//   chunk  = checksum:u64 number:u64 type:u16 flags:u16 raw_bytes:u32 stored_bytes:u32 payload
//
// Little endian. A checksum is XXH3 (64 bits) of all other bytes of its header
// or chunk; numbers count up from 0; flags are 0. The payload is stored_bytes
// long, and raw_bytes once unpacked by zstd: of what Debian keeps it is the one
// that packs samples both small and in microseconds per tick. Lengths are within
// limits before anything is allocated for them.
//
// Threads: any. Not for real-time code.
#pragma once

#include <cstdint>
#include <istream>
#include <string>
#include <string_view>

#include "server/recording/recording.h"

namespace palpate {

// 3 says more of a scene than 2; both are read.
inline constexpr std::uint32_t kRecordingVersion = 4;
inline constexpr std::uint32_t kOldestRecordingVersion = 2;
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

std::string FrameHeader(const RecordingHeader& header);
// kTooLarge for a payload above kMaxPayloadBytes.
std::string FrameChunk(const Payload& payload, std::uint64_t number);

// Throws Error(kInvalidArgument), naming `file`, for what is no recording of this
// version or has a damaged header.
RecordingHeader ReadHeader(std::istream& stream, const std::string& file);

// False at the end of the stream. Throws DamagedBytes for a chunk that is cut,
// changed, or not number `number`.
bool ReadChunk(std::istream& stream, std::uint64_t number, Payload& payload);

}  // namespace palpate
