// MCAP files (https://mcap.dev/spec), as far as recordings have them: their records, and how they
// are written and read.
#pragma once

#include <cstdint>
#include <functional>
#include <istream>
#include <map>
#include <memory>
#include <optional>
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
//
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

std::string Frame(Opcode opcode, std::string_view content);
std::string Encode(const Schema& schema);
std::string Encode(const Channel& channel);
std::string Encode(const Metadata& metadata);
std::string Encode(const ChunkIndex& index);

// Writes an MCAP file: schemas and channels plainly, then chunks with their message indexes, then
// the summary. Each piece is whole when it is handed over: a file that is cut has whole chunks.
//
// Threads: one at a time. Not for real-time code. Errors: those of `append`.
class Writer {
 public:
  using Append = std::function<void(std::string_view bytes)>;

  // Nothing is written before the first EndChunk. `library`: the program and its version.
  Writer(Append append, const std::string& library);

  // Before the first message. Returns the number of the channel.
  std::uint16_t AddChannel(const std::string& topic, const std::string& schema_name,
                           const std::string& schema_data, const Texts& metadata = {});
  // Between chunks.
  void AddMetadata(const Metadata& metadata);
  // Into the present chunk. Times do not fall.
  void AddMessage(std::uint16_t channel, std::uint64_t time_ns, std::string_view data);
  // Bytes of the present chunk, not packed.
  std::size_t chunk_bytes() const { return chunk_.size(); }
  // Ends the present chunk, if it has messages, and writes all that is not written yet, as one
  // piece. After an error of `append`, the next call tries again.
  void EndChunk();
  // Writes the summary and the end. Nothing may follow.
  void End();

 private:
  struct Index {
    std::uint64_t time_ns;
    std::uint64_t offset;
  };

  // The present chunk and its message indexes. `place`: where it will be. `index`: is set.
  std::string PackedChunk(std::uint64_t place, ChunkIndex& index) const;
  // Hands bytes over and counts them; the CRC of the data is that of all bytes before its record.
  void Write(std::string_view bytes);
  std::string Summary(std::uint64_t start) const;
  std::string Statistics() const;

  const Append append_;
  std::string waiting_;  // what comes before the present chunk
  std::uint64_t place_ = 0;
  std::uint32_t data_crc_ = 0;
  std::vector<Schema> schemas_;
  std::vector<Channel> channels_;
  std::map<std::uint16_t, std::uint64_t> counts_;  // messages, by channel
  std::vector<ChunkIndex> chunks_;
  std::string metadata_indexes_;
  std::uint32_t metadata_count_ = 0;
  std::string chunk_;
  std::uint64_t first_time_ns_ = 0, last_time_ns_ = 0;  // of the present chunk
  std::map<std::uint16_t, std::vector<Index>> indexes_;
};

struct Message {
  const Channel* channel = nullptr;  // as long as the reader lives
  std::uint64_t time_ns = 0;         // log_time
  std::string_view data{};           // until the next call
};

// Reads an MCAP file, message by message, in the order of the file, up to its end or its first
// damage. Holds one chunk (16 MiB, packed and unpacked) at a time, however large the file is. A
// file that unpacks to more than 64 times its size, and 16 MiB, is damaged. Indexes and attachments
// are skipped; the summary must be whole.
//
// Threads: one at a time. Not for real-time code. Errors: DamagedBytes; nothing may be read
// afterwards.
class Reader {
 public:
  // Reads the header. Throws DamagedBytes if the stream does not begin as an MCAP file.
  explicit Reader(std::unique_ptr<std::istream> stream);

  // None at the end of the file, whether it was closed or not.
  std::optional<Message> Next();
  // The file was closed, and has been read to its end. Its checksums fit.
  bool is_complete() const { return is_complete_; }
  // Of what has been read so far. Of one name, the last one.
  const std::map<std::string, Texts>& metadata() const { return metadata_; }
  // The name of the message's schema; empty if it is not known, or no protobuf.
  std::string_view SchemaOf(const Message& message) const;

 private:
  // Reads a record that is in no chunk. False at the end.
  bool ReadRecord();
  void Take(Opcode opcode, std::string_view content);
  void TakeMessage(std::string_view content);
  void Declare(Opcode opcode, std::string_view content);
  void OpenChunk(std::string_view content);
  void ReadSummary();
  std::string ReadBytes(std::uint64_t count);
  // Hands over `count` bytes in parts.
  void ReadParts(std::uint64_t count, const std::function<void(std::string_view)>& take);

  const std::unique_ptr<std::istream> stream_;
  std::uint64_t left_ = 0;                        // bytes of the file
  std::uint64_t unpacked_left_ = 0;               // bytes that chunks may still unpack to
  std::uint32_t crc_ = 0;                         // of the data so far
  std::map<std::uint16_t, std::string> schemas_;  // names; of protobuf
  std::map<std::uint16_t, Channel> channels_;
  std::uint64_t declared_bytes_ = 0;
  std::map<std::string, Texts> metadata_;
  std::string record_;
  std::string chunk_;  // unpacked
  ByteReader in_chunk_{std::string_view()};
  std::optional<Message> message_;
  bool is_complete_ = false;
};

}  // namespace palpate::mcap
