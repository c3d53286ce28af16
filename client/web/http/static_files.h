// The page: all files of a folder, read once.
//
// A request finds a file by looking up its path in a map. So no path reaches anything else.
//
// Threads: any, once constructed. Errors: Error (no folder, no index.html, too large).
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "client/web/volume/blob.h"

namespace palpate::web {

struct StaticFile {
  BlobPtr content;  // compressed at the start
  std::string etag;
};

class StaticFiles {
 public:
  explicit StaticFiles(const std::filesystem::path& folder);

  // `path`: that of the request, such as "/app.js"; "/" is index.html. Null: there is none.
  const StaticFile* Find(std::string_view path) const;

 private:
  std::map<std::string, StaticFile, std::less<>> files_;
};

}  // namespace palpate::web
