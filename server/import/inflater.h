// Inflates a part of a file. Detects gzip (also several members in a row) or zlib from the data.
//
// Threads: one. Reads the given file. Errors: palpate::Error for truncated and damaged data,
// std::bad_alloc.
#pragma once

#include <zlib.h>

#include <cstdint>
#include <fstream>
#include <vector>

namespace palpate {

class Inflater {
 public:
  // Inflates `length` bytes of the file from `begin` on. `in` must outlive this object.
  Inflater(std::ifstream* in, std::int64_t begin, std::int64_t length);
  ~Inflater();
  Inflater(const Inflater&) = delete;
  Inflater& operator=(const Inflater&) = delete;

  // Fills `out` as far as data exist, and returns the number of bytes.
  std::size_t Read(char* out, std::size_t count);

 private:
  bool Refill();
  bool StartNextMember();

  std::ifstream* in_;
  std::int64_t left_;
  std::vector<char> input_;
  z_stream stream_{};
  bool ended_ = false;
};

}  // namespace palpate
