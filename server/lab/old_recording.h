// Reads the recordings that Palpate wrote before it wrote MCAP files: versions 2 to 6. Only
// palpate-lab convert needs it, and only for one release.
//
//   file   = header chunk*
//   header = magic[8] version:u32 program_size:u32 created_unix_ns:i64 program
//            created_monotonic_ns:i64 checksum:u64
//   chunk  = checksum:u64 number:u64 type:u16 flags:u16 raw_bytes:u32 stored_bytes:u32 payload
//
// Little endian. Before version 6, created_monotonic_ns is absent. A checksum is XXH3 (64 bits) of
// all other bytes of its header or chunk. Numbers count up from 0; flags are 0. The payload has
// stored_bytes bytes; unpacked by zstd, it has raw_bytes bytes.
//
// Threads: one at a time. Errors: as RecordingReader.
#pragma once

#include <cstdint>
#include <istream>
#include <memory>
#include <optional>
#include <string>

#include "server/recording/recording.h"

namespace palpate::lab {

class OldRecording {
 public:
  // `name`: used in messages. Throws Error(kInvalidArgument) if the stream is no such recording.
  OldRecording(std::unique_ptr<std::istream> stream, std::string name);

  const RecordingHeader& header() const { return header_; }

  // None at the end. Markers stand at some tick nearby: their times tell the right one.
  std::optional<RecordedItem> Next();
  // One line that says why reading stopped early; empty if it did not.
  const std::string& stopped_because() const { return stopped_because_; }

 private:
  // The payload; none at the end of the file.
  struct Payload {
    std::uint16_t type = 0;
    std::string bytes{};
  };
  std::optional<Payload> ReadChunk();
  std::string ReadUpTo(std::size_t count);
  void CheckOrder(const RecordedItem& item);

  std::unique_ptr<std::istream> stream_;
  std::string name_;
  RecordingHeader header_;
  std::uint64_t next_number_ = 0;
  std::uint64_t next_tick_ = 0;
  bool is_over_ = false;
  std::string stopped_because_;
};

}  // namespace palpate::lab
