#include "server/recording/mcap_reader.h"

#include <zstd.h>

#include <algorithm>
#include <utility>

namespace palpate::mcap {
namespace {

// Schemas, channels and metadata together; each counts for its parts in memory, too.
constexpr std::uint64_t kMostDeclaredBytes = std::uint64_t{16} << 20;
constexpr std::uint64_t kBytesPerDeclaration = 512;
// A small file may unpack to terabytes; recordings unpack to less than thirty times their size.
constexpr std::uint64_t kMostUnpacked = 64;
constexpr std::uint64_t kFreeUnpackedBytes = std::uint64_t{16} << 20;
constexpr std::uint64_t kBytesPerPart = std::uint64_t{64} << 10;

std::uint64_t SizeOf(std::istream& stream) {
  stream.seekg(0, std::ios::end);
  const auto end = stream.tellg();
  stream.seekg(0);
  return stream && end > 0 ? static_cast<std::uint64_t>(end) : 0;
}

// A frame that names its size must name that of the chunk.
std::string Unpack(std::string_view packing, std::string_view packed, std::uint64_t bytes) {
  if (bytes > kMostChunkBytes) throw DamagedBytes("damaged: a chunk is too large");
  if (packing.empty() && packed.size() == bytes) return std::string(packed);
  if (packing == "lz4") throw DamagedBytes("packed by lz4, which Palpate does not read: use zstd");
  const auto named = ZSTD_getFrameContentSize(packed.data(), packed.size());
  const bool is_one = ZSTD_findFrameCompressedSize(packed.data(), packed.size()) == packed.size();
  std::string unpacked;
  if (packing == kZstd && is_one && (named == bytes || named == ZSTD_CONTENTSIZE_UNKNOWN)) {
    unpacked.resize(bytes);
    const std::size_t size = ZSTD_decompress(unpacked.data(), bytes, packed.data(), packed.size());
    if (size == bytes) return unpacked;
  }
  throw DamagedBytes("damaged: a chunk does not unpack");
}

void CheckCrc(std::uint32_t stored, std::uint32_t computed) {
  // 0: none was stored.
  if (stored != 0 && stored != computed) throw DamagedBytes("damaged: a checksum does not fit");
}

}  // namespace

Reader::Reader(std::unique_ptr<std::istream> stream)
    : stream_(std::move(stream)),
      left_(SizeOf(*stream_)),
      unpacked_left_(kMostUnpacked * left_ + kFreeUnpackedBytes) {
  if (left_ < kMagic.size() || ReadBytes(kMagic.size()) != kMagic) {
    throw DamagedBytes("no MCAP file");
  }
  crc_ = Crc(0, kMagic);
  ReadRecord();
}

std::string Reader::ReadBytes(std::uint64_t count) {
  if (count > left_) throw DamagedBytes("cut");
  std::string bytes(count, '\0');
  if (!stream_->read(bytes.data(), static_cast<std::streamsize>(count))) throw DamagedBytes("cut");
  left_ -= count;
  return bytes;
}

void Reader::ReadParts(std::uint64_t count, const std::function<void(std::string_view)>& take) {
  if (count > left_) throw DamagedBytes("cut");
  for (; count > 0; count -= std::min(count, kBytesPerPart)) {
    take(ReadBytes(std::min(count, kBytesPerPart)));
  }
}

std::string_view Reader::SchemaOf(const Message& message) const {
  const auto schema = schemas_.find(message.channel->schema);
  const bool is_known = message.channel->encoding == "protobuf" && schema != schemas_.end();
  return is_known ? std::string_view(schema->second) : "";
}

std::optional<Message> Reader::Next() {
  message_.reset();
  while (!message_) {
    if (!in_chunk_.at_end()) {
      const auto opcode = static_cast<Opcode>(in_chunk_.Get<std::uint8_t>());
      const std::string_view content = in_chunk_.GetBytes(in_chunk_.Get<std::uint64_t>());
      if (opcode == Opcode::kChunk) throw DamagedBytes("damaged: a chunk within a chunk");
      if (opcode != Opcode::kMetadata) Take(opcode, content);
    } else if (is_complete_ || !ReadRecord()) {
      return std::nullopt;
    }
  }
  return message_;
}

bool Reader::ReadRecord() {
  if (left_ == 0) return false;
  const std::string head = ReadBytes(kRecordHeadBytes);
  ByteReader reader(head);
  const auto opcode = static_cast<Opcode>(reader.Get<std::uint8_t>());
  const auto bytes = reader.Get<std::uint64_t>();
  if (opcode == Opcode::kDataEnd) {
    CheckCrc(ByteReader(ReadBytes(std::min(bytes, kMostRecordBytes))).Get<std::uint32_t>(), crc_);
    ReadSummary();
    return false;
  }
  crc_ = Crc(crc_, head);
  if (opcode > Opcode::kChunk && opcode != Opcode::kMetadata) {
    // Indexes, attachments, and records of later versions.
    ReadParts(bytes, [&](std::string_view part) { crc_ = Crc(crc_, part); });
    return true;
  }
  if (bytes > (opcode == Opcode::kChunk ? kMostChunkBytes : kMostRecordBytes)) {
    throw DamagedBytes("damaged: a record is too large");
  }
  // What was there before makes room first.
  record_ = {};
  chunk_ = {};
  record_ = ReadBytes(bytes);
  crc_ = Crc(crc_, record_);
  Take(opcode, record_);
  return true;
}

void Reader::Take(Opcode opcode, std::string_view content) {
  switch (opcode) {
    case Opcode::kSchema:
    case Opcode::kChannel:
    case Opcode::kMetadata:
      return Declare(opcode, content);
    case Opcode::kMessage:
      return TakeMessage(content);
    case Opcode::kChunk:
      return OpenChunk(content);
    default:
      return;
  }
}

// Chunks may declare again what is known: the first holds. No schema has the number 0.
void Reader::Declare(Opcode opcode, std::string_view content) {
  const auto id = opcode == Opcode::kMetadata ? 0 : ByteReader(content).Get<std::uint16_t>();
  if (opcode == Opcode::kSchema ? schemas_.contains(id)
                                : opcode == Opcode::kChannel && channels_.contains(id)) {
    return;
  }
  declared_bytes_ += kBytesPerDeclaration + 4 * content.size();
  if (declared_bytes_ > kMostDeclaredBytes) throw DamagedBytes("damaged: it has too many channels");
  if (opcode == Opcode::kSchema) {
    if (id != 0) schemas_.emplace(id, NameOfSchema(content));
  } else if (opcode == Opcode::kChannel) {
    channels_.emplace(id, DecodeChannel(content));
  } else {
    Metadata metadata = DecodeMetadata(content);
    metadata_.try_emplace(metadata.name, std::move(metadata.texts));
  }
}

void Reader::TakeMessage(std::string_view content) {
  ByteReader reader(content);
  const auto channel = channels_.find(reader.Get<std::uint16_t>());
  if (channel == channels_.end()) throw DamagedBytes("damaged: a message has no channel");
  reader.Get<std::uint32_t>();  // sequence
  const auto time_ns = reader.Get<std::uint64_t>();
  reader.Get<std::uint64_t>();  // publish_time
  message_ = {&channel->second, time_ns, reader.GetRest()};
}

void Reader::OpenChunk(std::string_view content) {
  ByteReader reader(content);
  reader.Get<std::uint64_t>();  // times of the first and the last message
  reader.Get<std::uint64_t>();
  const auto bytes = reader.Get<std::uint64_t>();
  const auto crc = reader.Get<std::uint32_t>();
  const std::string packing = reader.GetText();
  const std::string_view packed = reader.GetBytes(reader.Get<std::uint64_t>());
  reader.ExpectEnd();
  if (bytes > unpacked_left_) {
    throw DamagedBytes("damaged: it holds more than a file of its size can");
  }
  unpacked_left_ -= bytes;
  chunk_ = Unpack(packing, packed, bytes);
  CheckCrc(crc, Crc(0, chunk_));
  in_chunk_ = ByteReader(chunk_);
}

// Only its end is kept: a long recording has many indexes.
void Reader::ReadSummary() {
  constexpr std::size_t kEndBytes = kRecordHeadBytes + kFooterBytes + kMagic.size();
  constexpr std::size_t kCrcBytes = sizeof(std::uint32_t);
  if (left_ < kEndBytes) throw DamagedBytes("cut within its summary");
  std::uint32_t crc = 0;
  ReadParts(left_ - kEndBytes, [&](std::string_view part) { crc = Crc(crc, part); });
  const std::string end = ReadBytes(kEndBytes);
  if (!std::string_view(end).ends_with(kMagic)) throw DamagedBytes("cut within its summary");
  if (end[0] != static_cast<char>(Opcode::kFooter)) throw DamagedBytes("damaged: it has no footer");
  const std::size_t crc_place = kEndBytes - kMagic.size() - kCrcBytes;
  CheckCrc(ByteReader(std::string_view(end).substr(crc_place)).Get<std::uint32_t>(),
           Crc(crc, std::string_view(end).substr(0, crc_place)));
  is_complete_ = true;
}

}  // namespace palpate::mcap
