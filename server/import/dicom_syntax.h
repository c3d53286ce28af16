// DICOM's transfer syntaxes: how a file and its pixels are encoded.
//
// Pure. Threads: any. Errors: palpate::Error, see image_header.h.
#pragma once

#include <string>

namespace palpate {

// Refuses a transfer syntax that we or GDCM cannot read, by its name. Empty: not stated.
void CheckDicomSyntax(const std::string& uid);

}  // namespace palpate
