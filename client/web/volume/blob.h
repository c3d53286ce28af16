// Bytes that browsers fetch under a name that is a hash of them, so that they never change: groups
// of voxels, overviews, manifests.
//
// Threads: any, at once. Errors: kInternal (bytes that cannot be compressed), and as stated.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>

namespace palpate::web {

enum class Encoding { kIdentity, kZstd, kGzip };

class Blob {
 public:
  // `bytes` makes the plain bytes, the same ones at every call, on any thread.
  // `content_type`: a literal.
  Blob(std::string name, std::string_view content_type, std::function<std::string()> bytes);
  // Of bytes that are already compressed, which it keeps. Encoded() throws kInvalidArgument if they
  // are not, or hold more than kMostBytes.
  Blob(std::string name, std::string_view content_type, std::shared_ptr<const std::string> zstd);
  ~Blob();
  Blob(const Blob&) = delete;
  Blob& operator=(const Blob&) = delete;

  const std::string& name() const { return name_; }  // 32 hex digits
  // "application/octet-stream" or "application/json".
  std::string_view content_type() const { return content_type_; }
  // Compresses when first asked for and keeps the result, as long as all blobs of the program keep
  // at most kMaxKeptBytes. Never null.
  std::shared_ptr<const std::string> Encoded(Encoding encoding) const;

  static constexpr std::size_t kMostBytes = std::size_t{64} << 20;
  static constexpr std::size_t kMaxKeptBytes = std::size_t{512} << 20;
  static std::size_t kept_bytes();  // compressed ones, of all blobs

 private:
  const std::string name_;
  const std::string_view content_type_;
  const std::function<std::string()> bytes_;
  mutable std::mutex mutex_;
  mutable std::shared_ptr<const std::string> zstd_, gzip_;  // null: not kept
};
using BlobPtr = std::shared_ptr<const Blob>;

}  // namespace palpate::web
