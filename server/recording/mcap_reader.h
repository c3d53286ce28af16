// Reads an MCAP file, message by message, in the order of the file, up to its end or its first
// damage. Holds one chunk (16 MiB, packed and unpacked) at a time, however large the file is. A
// file that unpacks to more than 64 times its size, and 16 MiB, is damaged. Indexes and attachments
// are skipped; the summary must be whole.
//
// Threads: one at a time. Not for real-time code. Errors: DamagedBytes; nothing may be read
// afterwards.
#pragma once

#include <cstdint>
#include <functional>
#include <istream>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "server/recording/bytes.h"
#include "server/recording/mcap_format.h"

namespace palpate::mcap {

struct Message {
  const Channel* channel = nullptr;  // as long as the reader lives
  std::uint64_t time_ns = 0;         // log_time
  std::string_view data{};           // until the next call
};

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
