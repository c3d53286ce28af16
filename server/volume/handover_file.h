// Reads and writes a hand-over, whatever its form (handover.h): whole pieces, or an Error.
//
// Not for real-time code. Threads: any.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace palpate {

// kInvalidArgument: what no importer of ours writes.
[[noreturn]] void RefuseHandover(const std::string& what);

// Of the call that set errno: kTooLarge where there is no room, else kInternal.
[[noreturn]] void FailHandover(const char* what);

void WriteHandoverAt(int fd, const void* data, std::size_t size, std::int64_t offset);
void ReadHandoverAt(int fd, void* data, std::size_t size, std::int64_t offset);

}  // namespace palpate
