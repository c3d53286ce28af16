// Tells the passes of a series apart: slices over the same range that do not make one volume, such
// as phases, echoes or two acquisitions, one between the slices of the other.
//
// Pure. Threads: any. Errors: none.
#pragma once

#include <string>
#include <vector>

#include "server/import/dicom_slice.h"

namespace palpate {

struct DicomPass {
  std::string number;       // to choose it by; empty: the only pass
  std::string description;  // "EchoNumbers 2, FlipAngle 5"
  std::vector<DicomSlice> slices;
};

// True if nothing tells the two slices apart as of two passes.
bool IsOfOnePass(const DicomSlice& one, const DicomSlice& other);

// `slices`: of one series, size and orientation, not empty. What differs between slices tells
// passes apart only if some lie between others, or at their places: a scanner that steps from place
// to place may number its steps, and one that measures in turns has several times. The number is
// the AcquisitionNumber where each pass has one of its own.
std::vector<DicomPass> PassesOf(std::vector<DicomSlice> slices);

}  // namespace palpate
