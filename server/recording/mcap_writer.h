// Writes an MCAP file: schemas and channels plainly, then chunks with their message indexes, then
// the summary. Each piece is whole when it is handed over: a file that is cut has whole chunks.
//
// Threads: one at a time. Not for real-time code. Errors: those of `append`.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "server/recording/mcap_format.h"

namespace palpate::mcap {

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

}  // namespace palpate::mcap
