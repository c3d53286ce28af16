// Reads and writes complete pieces of a hand-over file (handover.h), or throws an Error.
//
// Not for real-time code. Threads: any.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace palpate {

// Throws kInvalidArgument: the file is not from our importer.
[[noreturn]] void RefuseHandover(const std::string& what);

// Throws for the call that set errno: kTooLarge if there is no room, otherwise kInternal.
[[noreturn]] void FailHandover(const char* what);

void WriteHandoverAt(int fd, const void* data, std::size_t size, std::int64_t offset);
void ReadHandoverAt(int fd, void* data, std::size_t size, std::int64_t offset);

}  // namespace palpate
