// Files that hold secrets, or say who has which rights.
//
// Threads: any; they read the file system.
#pragma once

#include <filesystem>
#include <string>

namespace palpate::web {

// Why the file cannot be trusted: others may write it. Empty: it can, or there is none.
std::string WriteFault(const std::filesystem::path& file);

// `key` is that of the configuration, for the error. Errors: kNotFound, kPermissionDenied,
// kInvalidArgument (others may write the file, or all accounts may read it).
void CheckSecretFile(const std::string& key, const std::filesystem::path& file);

}  // namespace palpate::web
