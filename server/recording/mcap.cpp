#include "server/recording/mcap.h"

#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <utility>

#include "common/error/error.h"

namespace palpate::mcap {
namespace {

void Put(ByteWriter& writer, const Texts& texts) {
  ByteWriter list;
  for (const auto& [key, text] : texts) {
    list.PutText(key);
    list.PutText(text);
  }
  writer.PutText(list.bytes());
}

Texts GetTexts(ByteReader& reader) {
  ByteReader list(reader.GetBytes(reader.Get<std::uint32_t>()));
  Texts texts;
  while (!list.at_end()) {
    std::string key = list.GetText();
    // Other programs put whole files into them.
    texts[std::move(key)] = list.GetText(kMostRecordBytes);
  }
  return texts;
}

// CRC32, as of zlib: of what came before, and these bytes.
std::uint32_t Crc(std::uint32_t before, std::string_view bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(before, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

std::string NameOfSchema(std::string_view content) {
  ByteReader reader(content);
  reader.Get<std::uint16_t>();
  return reader.GetText();
}

Channel DecodeChannel(std::string_view content) {
  ByteReader reader(content);
  Channel channel;
  channel.id = reader.Get<std::uint16_t>();
  channel.schema = reader.Get<std::uint16_t>();
  channel.topic = reader.GetText();
  channel.encoding = reader.GetText();
  channel.metadata = GetTexts(reader);
  return channel;
}

Metadata DecodeMetadata(std::string_view content) {
  ByteReader reader(content);
  Metadata metadata;
  metadata.name = reader.GetText();
  metadata.texts = GetTexts(reader);
  return metadata;
}

}  // namespace

std::string Frame(Opcode opcode, std::string_view content) {
  ByteWriter writer;
  writer.Put(static_cast<std::uint8_t>(opcode));
  writer.Put(static_cast<std::uint64_t>(content.size()));
  writer.PutBytes(content);
  return std::move(writer).Take();
}

std::string Encode(const Schema& schema) {
  ByteWriter writer;
  writer.Put(schema.id);
  writer.PutText(schema.name);
  writer.PutText(schema.encoding);
  writer.PutText(schema.data);
  return Frame(Opcode::kSchema, writer.bytes());
}

std::string Encode(const Channel& channel) {
  ByteWriter writer;
  writer.Put(channel.id);
  writer.Put(channel.schema);
  writer.PutText(channel.topic);
  writer.PutText(channel.encoding);
  Put(writer, channel.metadata);
  return Frame(Opcode::kChannel, writer.bytes());
}

std::string Encode(const Metadata& metadata) {
  ByteWriter writer;
  writer.PutText(metadata.name);
  Put(writer, metadata.texts);
  return Frame(Opcode::kMetadata, writer.bytes());
}

std::string Encode(const ChunkIndex& index) {
  ByteWriter writer, places;
  for (const auto& [channel, place] : index.message_indexes) {
    places.Put(channel);
    places.Put(place);
  }
  writer.Put(index.first_time_ns);
  writer.Put(index.last_time_ns);
  writer.Put(index.place);
  writer.Put(index.bytes);
  writer.PutText(places.bytes());
  writer.Put(index.message_index_bytes);
  writer.PutText(index.packing);
  writer.Put(index.packed_bytes);
  writer.Put(index.unpacked_bytes);
  return Frame(Opcode::kChunkIndex, writer.bytes());
}

namespace {

// Level 3 saves 3 % of the bytes for twice the time.
constexpr int kLevel = 1;

std::string Pack(std::string_view bytes) {
  std::string packed(ZSTD_compressBound(bytes.size()), '\0');
  const std::size_t size =
      ZSTD_compress(packed.data(), packed.size(), bytes.data(), bytes.size(), kLevel);
  if (ZSTD_isError(size)) throw Error(ErrorKind::kInternal, ZSTD_getErrorName(size));
  packed.resize(size);
  return packed;
}

}  // namespace

Writer::Writer(Append append, const std::string& library) : append_(std::move(append)) {
  ByteWriter header;
  header.PutText("");  // no profile: those are of ROS
  header.PutText(library);
  waiting_ = kMagic;
  waiting_ += Frame(Opcode::kHeader, header.bytes());
}

std::uint16_t Writer::AddChannel(const std::string& topic, const std::string& schema_name,
                                 const std::string& schema_data, const Texts& metadata) {
  const auto schema = std::find_if(schemas_.begin(), schemas_.end(),
                                   [&](const Schema& known) { return known.name == schema_name; });
  auto schema_id = static_cast<std::uint16_t>(schema - schemas_.begin() + 1);
  if (schema == schemas_.end()) {
    schemas_.push_back({schema_id, schema_name, "protobuf", schema_data});
    waiting_ += Encode(schemas_.back());
  }
  const auto id = static_cast<std::uint16_t>(channels_.size());
  channels_.push_back({id, schema_id, topic, "protobuf", metadata});
  waiting_ += Encode(channels_.back());
  return id;
}

void Writer::AddMetadata(const Metadata& metadata) {
  const std::string record = Encode(metadata);
  ByteWriter index;
  index.Put(place_ + waiting_.size());
  index.Put(static_cast<std::uint64_t>(record.size()));
  index.PutText(metadata.name);
  metadata_indexes_ += Frame(Opcode::kMetadataIndex, index.bytes());
  ++metadata_count_;
  waiting_ += record;
}

void Writer::AddMessage(std::uint16_t channel, std::uint64_t time_ns, std::string_view data) {
  if (chunk_.empty()) first_time_ns_ = time_ns;
  last_time_ns_ = time_ns;
  indexes_[channel].push_back({time_ns, chunk_.size()});
  AppendNumber(static_cast<std::uint8_t>(Opcode::kMessage), chunk_);
  AppendNumber(static_cast<std::uint64_t>(2 + 4 + 8 + 8 + data.size()), chunk_);
  AppendNumber(channel, chunk_);
  AppendNumber(static_cast<std::uint32_t>(counts_[channel]++), chunk_);
  AppendNumber(time_ns, chunk_);  // log_time
  AppendNumber(time_ns, chunk_);  // publish_time
  chunk_ += data;
}

void Writer::EndChunk() {
  std::string bytes = waiting_;
  ChunkIndex index;
  if (!chunk_.empty()) bytes += PackedChunk(place_ + bytes.size(), index);
  Write(bytes);
  waiting_.clear();
  if (chunk_.empty()) return;
  chunks_.push_back(std::move(index));
  chunk_.clear();
  indexes_.clear();
}

std::string Writer::PackedChunk(std::uint64_t place, ChunkIndex& index) const {
  const std::string packed = Pack(chunk_);
  ByteWriter content;
  content.Put(first_time_ns_);
  content.Put(last_time_ns_);
  content.Put(static_cast<std::uint64_t>(chunk_.size()));
  content.Put(Crc(0, chunk_));
  content.PutText(kZstd);
  content.Put(static_cast<std::uint64_t>(packed.size()));
  content.PutBytes(packed);
  std::string bytes = Frame(Opcode::kChunk, content.bytes());
  index = {.first_time_ns = first_time_ns_,
           .last_time_ns = last_time_ns_,
           .place = place,
           .bytes = bytes.size(),
           .packing = std::string(kZstd),
           .packed_bytes = packed.size(),
           .unpacked_bytes = chunk_.size()};
  for (const auto& [channel, messages] : indexes_) {
    index.message_indexes[channel] = place + bytes.size();
    ByteWriter list;
    list.Put(channel);
    list.Put(static_cast<std::uint32_t>(messages.size() * sizeof(Index)));
    for (const Index& message : messages) {
      list.Put(message.time_ns);
      list.Put(message.offset);
    }
    bytes += Frame(Opcode::kMessageIndex, list.bytes());
  }
  index.message_index_bytes = bytes.size() - index.bytes;
  return bytes;
}

void Writer::End() {
  EndChunk();
  ByteWriter end;
  end.Put(data_crc_);
  std::string bytes = Frame(Opcode::kDataEnd, end.bytes());
  bytes += Summary(place_ + bytes.size());
  Write(bytes);
}

// The summary, the footer and the magic: groups of records, then where each group is.
std::string Writer::Summary(std::uint64_t start) const {
  std::string summary, offsets;
  const auto group = [&](Opcode opcode, const std::string& records) {
    if (records.empty()) return;
    ByteWriter offset;
    offset.Put(static_cast<std::uint8_t>(opcode));
    offset.Put(start + summary.size());
    offset.Put(static_cast<std::uint64_t>(records.size()));
    offsets += Frame(Opcode::kSummaryOffset, offset.bytes());
    summary += records;
  };
  const auto all = [](const auto& records) {
    std::string bytes;
    for (const auto& record : records) bytes += Encode(record);
    return bytes;
  };
  group(Opcode::kSchema, all(schemas_));
  group(Opcode::kChannel, all(channels_));
  group(Opcode::kStatistics, Statistics());
  group(Opcode::kChunkIndex, all(chunks_));
  group(Opcode::kMetadataIndex, metadata_indexes_);
  const std::uint64_t offsets_start = start + summary.size();
  summary += offsets;
  ByteWriter footer;
  footer.Put(static_cast<std::uint8_t>(Opcode::kFooter));
  footer.Put(kFooterBytes);
  footer.Put(start);
  footer.Put(offsets_start);
  summary += footer.bytes();
  ByteWriter crc;
  crc.Put(Crc(0, summary));  // of the footer up to here, too
  return summary + crc.bytes() + std::string(kMagic);
}

std::string Writer::Statistics() const {
  ByteWriter writer, counts;
  std::uint64_t all = 0;
  for (const auto& [channel, count] : counts_) {
    counts.Put(channel);
    counts.Put(count);
    all += count;
  }
  writer.Put(all);
  writer.Put(static_cast<std::uint16_t>(schemas_.size()));
  writer.Put(static_cast<std::uint32_t>(channels_.size()));
  writer.Put(std::uint32_t{0});  // attachments
  writer.Put(metadata_count_);
  writer.Put(static_cast<std::uint32_t>(chunks_.size()));
  writer.Put(chunks_.empty() ? std::uint64_t{0} : chunks_.front().first_time_ns);
  writer.Put(chunks_.empty() ? std::uint64_t{0} : chunks_.back().last_time_ns);
  writer.PutText(counts.bytes());
  return Frame(Opcode::kStatistics, writer.bytes());
}

void Writer::Write(std::string_view bytes) {
  append_(bytes);
  data_crc_ = Crc(data_crc_, bytes);
  place_ += bytes.size();
}

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
