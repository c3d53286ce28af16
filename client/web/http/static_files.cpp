#include "client/web/http/static_files.h"

#include <array>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <memory>
#include <utility>

#include "client/web/logins/secret.h"
#include "common/error/error.h"

namespace palpate::web {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMaxBytes = std::uintmax_t{64} << 20;

constexpr std::array<std::pair<std::string_view, std::string_view>, 10> kContentTypes = {{
    {".html", "text/html; charset=utf-8"},
    {".js", "text/javascript; charset=utf-8"},
    {".css", "text/css; charset=utf-8"},
    {".svg", "image/svg+xml"},
    {".png", "image/png"},
    {".ico", "image/x-icon"},
    {".json", "application/json"},
    {".map", "application/json"},
    {".woff2", "font/woff2"},
    {".txt", "text/plain; charset=utf-8"},
}};

std::string_view ContentTypeOf(const fs::path& file) {
  for (const auto& [extension, type] : kContentTypes) {
    if (file.extension() == extension) return type;
  }
  return "application/octet-stream";
}

StaticFile Read(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  auto bytes = std::make_shared<const std::string>(std::istreambuf_iterator<char>(file),
                                                   std::istreambuf_iterator<char>());
  if (!file) throw Error(ErrorKind::kPermissionDenied, "cannot read " + path.string());
  const std::string name = ToHex(Sha256(*bytes)).substr(0, 32);
  auto content =
      std::make_shared<const Blob>(name, ContentTypeOf(path), [bytes] { return *bytes; });
  content->Encoded(Encoding::kZstd);
  content->Encoded(Encoding::kGzip);
  // Weak: the same for all encodings.
  return {std::move(content), "W/\"" + name + "\""};
}

}  // namespace

StaticFiles::StaticFiles(const fs::path& folder) {
  std::error_code problem;
  std::uintmax_t bytes = 0;
  for (fs::recursive_directory_iterator file(folder, problem), end; !problem && file != end;
       file.increment(problem)) {
    if (!file->is_regular_file()) continue;
    bytes += file->file_size();
    if (bytes > kMaxBytes) {
      throw Error(ErrorKind::kTooLarge, folder.string() + " has more than 64 MiB: it is no page");
    }
    files_["/" + file->path().lexically_relative(folder).string()] = Read(file->path());
  }
  const auto index = files_.find("/index.html");
  if (index == files_.end()) {
    throw Error(ErrorKind::kNotFound, folder.string() +
                                          " has no index.html: name the page's "
                                          "folder with --page");
  }
  files_["/"] = index->second;
}

const StaticFile* StaticFiles::Find(std::string_view path) const {
  const auto found = files_.find(path);
  return found == files_.end() ? nullptr : &found->second;
}

}  // namespace palpate::web
