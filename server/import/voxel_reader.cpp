#include "server/import/voxel_reader.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <fstream>
#include <new>
#include <optional>
#include <type_traits>
#include <vector>

#include "server/import/image_header.h"

namespace palpate {
namespace {

constexpr std::size_t kInputBytes = 1 << 18;

}  // namespace

Inflater::Inflater(std::ifstream* in, std::int64_t begin, std::int64_t length)
    : in_(in), left_(length), input_(kInputBytes) {
  in_->seekg(begin);
  // 32: detects gzip or zlib from the data.
  if (inflateInit2(&stream_, 15 + 32) != Z_OK) throw std::bad_alloc();
}

Inflater::~Inflater() { inflateEnd(&stream_); }

std::size_t Inflater::Read(char* out, std::size_t count) {
  stream_.next_out = reinterpret_cast<Bytef*>(out);
  stream_.avail_out = static_cast<uInt>(count);
  while (stream_.avail_out > 0 && !ended_) {
    if (stream_.avail_in == 0 && !Refill()) {
      Refuse("the compressed data end too early; the file is truncated");
    }
    const int result = inflate(&stream_, Z_NO_FLUSH);
    if (result == Z_STREAM_END) {
      ended_ = !StartNextMember();
    } else if (result != Z_OK && result != Z_BUF_ERROR) {
      Refuse("the compressed data are damaged; copy or download the file again");
    }
  }
  return count - stream_.avail_out;
}

bool Inflater::Refill() {
  const auto wanted = std::min<std::int64_t>(left_, static_cast<std::int64_t>(input_.size()));
  in_->read(input_.data(), wanted);
  stream_.next_in = reinterpret_cast<Bytef*>(input_.data());
  stream_.avail_in = static_cast<uInt>(in_->gcount());
  left_ -= in_->gcount();
  in_->clear();
  return stream_.avail_in > 0;
}

bool Inflater::StartNextMember() {
  constexpr Bytef kGzipStart = 0x1f;
  if (stream_.avail_in == 0 && !Refill()) return false;
  return *stream_.next_in == kGzipStart && inflateReset(&stream_) == Z_OK;
}

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kChunk = 1 << 18;  // a multiple of the bytes of every voxel type

template <typename Number, typename Out>
void Decode(const char* bytes, std::size_t count, const ImageHeader& header, Out* out) {
  const bool swap = header.big_endian != (std::endian::native == std::endian::big);
  const bool scaled = header.slope != 1.0 || header.intercept != 0.0;
  if (std::is_same_v<Number, Out> && !swap && !scaled) {
    std::memcpy(out, bytes, count * sizeof(Number));
    return;
  }
  for (std::size_t k = 0; k < count; ++k) {
    char one[sizeof(Number)];
    std::memcpy(one, bytes + k * sizeof(Number), sizeof(Number));
    if (swap) std::reverse(one, one + sizeof(Number));
    Number number;
    std::memcpy(&number, one, sizeof(Number));
    out[k] = scaled ? static_cast<Out>(header.intercept + header.slope * number)
                    : static_cast<Out>(number);
  }
}

template <typename Number>
void DecodeAs(const char* bytes, std::size_t count, const ImageHeader& header, void* out) {
  if (ReadType(header) == LeafType::kFloat) {
    Decode<Number>(bytes, count, header, static_cast<float*>(out));
  } else {
    Decode<Number>(bytes, count, header, static_cast<Number*>(out));
  }
}

// The bytes of the voxels' stream, inflated if the stream is deflated.
class ByteStream {
 public:
  ByteStream(const fs::path& path, std::int64_t begin, const ImageHeader& header)
      : in_(path, std::ios::binary) {
    if (!in_) Refuse("the file cannot be opened");
    if (!header.compressed) {
      in_.seekg(begin);
      return;
    }
    const bool whole = header.compressed_bytes == ImageHeader::kToFileEnd;
    const auto rest = static_cast<std::int64_t>(fs::file_size(path)) - begin;
    inflater_.emplace(&in_, begin, whole ? rest : header.compressed_bytes);
  }

  void Read(char* out, std::size_t count) {
    std::size_t got = 0;
    if (inflater_) {
      got = inflater_->Read(out, count);
    } else {
      in_.read(out, static_cast<std::streamsize>(count));
      got = static_cast<std::size_t>(in_.gcount());
    }
    if (got != count) Refuse("the voxels end too early; the file is truncated");
  }

  void Skip(std::int64_t count) {
    if (!inflater_) {
      in_.seekg(count, std::ios::cur);
      return;
    }
    std::vector<char> sink(kChunk);
    for (; count > 0; count -= static_cast<std::int64_t>(kChunk)) {
      Read(sink.data(), static_cast<std::size_t>(std::min<std::int64_t>(count, kChunk)));
    }
  }

 private:
  std::ifstream in_;
  std::optional<Inflater> inflater_;
};

}  // namespace

void DecodeVoxels(const char* bytes, std::size_t count, const ImageHeader& header, void* out) {
  switch (header.type) {
    case ScalarType::kInt8:
      return DecodeAs<std::int8_t>(bytes, count, header, out);
    case ScalarType::kUint8:
      return DecodeAs<std::uint8_t>(bytes, count, header, out);
    case ScalarType::kInt16:
      return DecodeAs<std::int16_t>(bytes, count, header, out);
    case ScalarType::kUint16:
      return DecodeAs<std::uint16_t>(bytes, count, header, out);
    case ScalarType::kInt32:
      return DecodeAs<std::int32_t>(bytes, count, header, out);
    case ScalarType::kUint32:
      return DecodeAs<std::uint32_t>(bytes, count, header, out);
    case ScalarType::kFloat32:
      return DecodeAs<float>(bytes, count, header, out);
    case ScalarType::kFloat64:
      return DecodeAs<double>(bytes, count, header, out);
  }
}

void ReadVoxels(const fs::path& path, const ImageHeader& header, std::int64_t frame,
                const VoxelSink& sink) {
  const std::int64_t voxels = header.size[0] * header.size[1] * header.size[2];
  const std::int64_t frame_bytes = voxels * ByteCount(header.type);
  const fs::path data = header.data_file.empty() ? path : path.parent_path() / header.data_file;
  const bool at_end = header.skip_bytes == ImageHeader::kVoxelsAtEnd;
  const std::int64_t begin =
      at_end ? static_cast<std::int64_t>(fs::file_size(data)) - header.frames * frame_bytes
             : header.begin;
  ByteStream stream(data, begin, header);
  stream.Skip((at_end ? 0 : header.skip_bytes) + frame * frame_bytes);

  const LeafType type = ReadType(header);
  const std::size_t bytes_per_voxel = static_cast<std::size_t>(ByteCount(header.type));
  const std::int64_t chunk_voxels = static_cast<std::int64_t>(kChunk / bytes_per_voxel);
  std::vector<char> chunk(kChunk);
  std::vector<char> decoded(static_cast<std::size_t>(chunk_voxels) * VoxelBytes(type));
  for (std::int64_t done = 0; done < voxels; done += chunk_voxels) {
    const auto count = static_cast<std::size_t>(std::min(chunk_voxels, voxels - done));
    stream.Read(chunk.data(), count * bytes_per_voxel);
    DecodeVoxels(chunk.data(), count, header, decoded.data());
    sink(type, decoded.data(), count);
  }
}

}  // namespace palpate
