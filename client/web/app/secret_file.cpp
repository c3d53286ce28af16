#include "client/web/app/secret_file.h"

#include <sys/stat.h>

#include <fstream>
#include <system_error>

#include "common/error/error.h"

namespace palpate::web {

namespace fs = std::filesystem;

std::string WriteFault(const fs::path& file) {
  struct stat info {};
  if (file.empty() || stat(file.c_str(), &info) != 0) return "";
  if ((info.st_mode & (S_IWGRP | S_IWOTH)) == 0) return "";
  return file.string() + ": others may write this file: chmod go-w " + file.string();
}

void CheckSecretFile(const std::string& key, const fs::path& file) {
  if (const std::string fault = WriteFault(file); !fault.empty()) Refuse(fault);
  struct stat info {};
  if (stat(file.c_str(), &info) == 0 && (info.st_mode & S_IROTH) != 0) {
    Refuse(key + ": all accounts may read this file: chmod o-r " + file.string());
  }
  if (std::ifstream(file)) return;
  std::error_code error;
  const bool exists = fs::exists(file, error);
  throw Error(exists ? ErrorKind::kPermissionDenied : ErrorKind::kNotFound,
              key + ": cannot read " + file.string());
}

}  // namespace palpate::web
