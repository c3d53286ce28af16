// Writes and reads numbers and texts as bytes: little endian, doubles by their bits.
//
// Threads: one per object. Not for real-time code (allocates).
// Errors: ByteReader throws DamagedBytes if the bytes end too early. It never allocates more than
// the size of the bytes.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

namespace palpate {

// Texts are shorter, unless the reader says otherwise.
inline constexpr std::size_t kMostTextBytes = std::size_t{16} << 10;

static_assert(std::endian::native == std::endian::little, "recordings are little endian");

// Thrown if bytes are not valid data. what() completes the sentence "the recording is ...".
class DamagedBytes : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

template <class T>
requires std::is_arithmetic_v<T>
void AppendNumber(T value, std::string& bytes) {
  bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
}

class ByteWriter {
 public:
  template <class T>
  requires std::is_arithmetic_v<T>
  void Put(T value) { AppendNumber(value, bytes_); }
  void PutBytes(std::string_view bytes) { bytes_ += bytes; }
  void PutText(std::string_view text) {
    Put(static_cast<std::uint32_t>(text.size()));
    PutBytes(text);
  }
  const std::string& bytes() const { return bytes_; }
  std::string Take() && { return std::move(bytes_); }

 private:
  std::string bytes_;
};

class ByteReader {
 public:
  // Borrows the bytes.
  explicit ByteReader(std::string_view bytes) : rest_(bytes) {}

  template <class T>
  requires std::is_arithmetic_v<T> T Get() {
    T value;
    std::memcpy(&value, GetBytes(sizeof value).data(), sizeof value);
    return value;
  }
  std::string_view GetBytes(std::size_t count) {
    if (count > rest_.size()) throw DamagedBytes("too short");
    const std::string_view bytes = rest_.substr(0, count);
    rest_.remove_prefix(count);
    return bytes;
  }
  std::string_view GetRest() { return GetBytes(rest_.size()); }
  // Texts of one letter pack well: a small file may hold gigabytes of them.
  std::string GetText(std::size_t most_bytes = kMostTextBytes) {
    const auto size = Get<std::uint32_t>();
    if (size > most_bytes) throw DamagedBytes("damaged: a text is too long");
    return std::string(GetBytes(size));
  }
  bool at_end() const { return rest_.empty(); }
  void ExpectEnd() const {
    if (!rest_.empty()) throw DamagedBytes("too long");
  }

 private:
  std::string_view rest_;
};

}  // namespace palpate
