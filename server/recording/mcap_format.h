// The records of an MCAP file (https://mcap.dev/spec), as far as recordings have them. The limits
// are those of Palpate: a length is compared with them, and with the bytes that are left, before
// memory is taken.
//
//   file   = magic record* magic
//   record = opcode:u8 bytes:u64 content
//
// Little endian. Texts and lists have their length in bytes before them, as u32. Times are in ns of
// Unix time (log_time).
//
// Threads: any. Not for real-time code (allocates). Errors: what is decoded throws DamagedBytes.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "server/recording/bytes.h"

namespace palpate::mcap {

inline constexpr std::string_view kMagic{"\x89MCAP0\r\n", 8};
inline constexpr std::string_view kZstd = "zstd";

inline constexpr std::uint64_t kMostChunkBytes = std::uint64_t{16} << 20;  // packed or unpacked
inline constexpr std::uint64_t kMostRecordBytes = std::uint64_t{4} << 20;  // of the others
inline constexpr std::size_t kRecordHeadBytes = 1 + 8;
inline constexpr std::uint64_t kFooterBytes = 8 + 8 + 4;

enum class Opcode : std::uint8_t {
  kHeader = 1,
  kFooter,
  kSchema,
  kChannel,
  kMessage,
  kChunk,
  kMessageIndex,
  kChunkIndex,
  kAttachment,
  kAttachmentIndex,
  kStatistics,
  kMetadata,
  kMetadataIndex,
  kSummaryOffset,
  kDataEnd,
};

using Texts = std::map<std::string, std::string>;

struct Schema {
  std::uint16_t id = 0;  // from 1 on
  std::string name{};    // "palpate.v1.RecordedTick"
  std::string encoding{};
  std::string data{};
};

struct Channel {
  std::uint16_t id = 0;
  std::uint16_t schema = 0;
  std::string topic{};
  std::string encoding{};
  Texts metadata{};
};

struct Metadata {
  std::string name{};
  Texts texts{};
};

// Where a chunk is; of the summary.
struct ChunkIndex {
  std::uint64_t first_time_ns = 0;
  std::uint64_t last_time_ns = 0;
  std::uint64_t place = 0;  // of its record, in bytes from the start of the file
  std::uint64_t bytes = 0;  // of its record
  std::map<std::uint16_t, std::uint64_t> message_indexes{};  // their places, by channel
  std::uint64_t message_index_bytes = 0;
  std::string packing{};  // kZstd, or "": not packed
  std::uint64_t packed_bytes = 0;
  std::uint64_t unpacked_bytes = 0;
};

// CRC32, as of zlib: of what came before, and these bytes.
std::uint32_t Crc(std::uint32_t before, std::string_view bytes);

std::string Frame(Opcode opcode, std::string_view content);
std::string Encode(const Schema& schema);
std::string Encode(const Channel& channel);
std::string Encode(const Metadata& metadata);
std::string Encode(const ChunkIndex& index);

std::string NameOfSchema(std::string_view content);
Channel DecodeChannel(std::string_view content);
Metadata DecodeMetadata(std::string_view content);

}  // namespace palpate::mcap
