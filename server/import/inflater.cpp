#include "server/import/inflater.h"

#include <algorithm>
#include <new>

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

}  // namespace palpate
