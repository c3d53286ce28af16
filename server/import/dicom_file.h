// Walks the elements of a DICOM file: collects what describes the image, and checks that all
// elements are complete, above all the pixels. GDCM reads truncated files as complete ones, and
// crashes on some valid ones, so that it gets to see the pixels only (reader_dicom.cpp).
//
// Pure except for the stream. Threads: one per stream. Errors: palpate::Error without the file's
// name, see image_header.h.
#pragma once

#include <cstdint>
#include <istream>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace palpate {

struct DicomTag {
  std::uint32_t number = 0;  // group and element
  const char* name = "";     // as the standard has it

  bool operator==(std::uint32_t other) const { return number == other; }
};

namespace dicom {
inline constexpr DicomTag kImageType{0x00080008, "ImageType"};
inline constexpr DicomTag kInstance{0x00080018, "SOPInstanceUID"};
inline constexpr DicomTag kAcquisitionDate{0x00080022, "AcquisitionDate"};
inline constexpr DicomTag kAcquisitionDateTime{0x0008002a, "AcquisitionDateTime"};
inline constexpr DicomTag kAcquisitionTime{0x00080032, "AcquisitionTime"};
inline constexpr DicomTag kContentTime{0x00080033, "ContentTime"};
inline constexpr DicomTag kModality{0x00080060, "Modality"};
inline constexpr DicomTag kDescription{0x0008103e, "SeriesDescription"};
inline constexpr DicomTag kComponent{0x00089208, "ComplexImageComponent"};
inline constexpr DicomTag kContrast{0x00180010, "ContrastBolusAgent"};
inline constexpr DicomTag kSequence{0x00180024, "SequenceName"};
inline constexpr DicomTag kThickness{0x00180050, "SliceThickness"};
inline constexpr DicomTag kKvp{0x00180060, "KVP"};
inline constexpr DicomTag kRepetitionTime{0x00180080, "RepetitionTime"};
inline constexpr DicomTag kEchoTime{0x00180081, "EchoTime"};
inline constexpr DicomTag kInversionTime{0x00180082, "InversionTime"};
inline constexpr DicomTag kEcho{0x00180086, "EchoNumbers"};
inline constexpr DicomTag kSlicePitch{0x00180088, "SpacingBetweenSlices"};
inline constexpr DicomTag kTriggerTime{0x00181060, "TriggerTime"};
inline constexpr DicomTag kFilter{0x00181160, "FilterType"};
inline constexpr DicomTag kKernel{0x00181210, "ConvolutionKernel"};
inline constexpr DicomTag kFlipAngle{0x00181314, "FlipAngle"};
inline constexpr DicomTag kBValue{0x00189087, "DiffusionBValue"};
inline constexpr DicomTag kStudy{0x0020000d, "StudyInstanceUID"};
inline constexpr DicomTag kSeries{0x0020000e, "SeriesInstanceUID"};
inline constexpr DicomTag kSeriesNumber{0x00200011, "SeriesNumber"};
inline constexpr DicomTag kAcquisition{0x00200012, "AcquisitionNumber"};
inline constexpr DicomTag kInstanceNumber{0x00200013, "InstanceNumber"};
inline constexpr DicomTag kPosition{0x00200032, "ImagePositionPatient"};
inline constexpr DicomTag kOrientation{0x00200037, "ImageOrientationPatient"};
inline constexpr DicomTag kFrameOfReference{0x00200052, "FrameOfReferenceUID"};
inline constexpr DicomTag kTimePosition{0x00200100, "TemporalPositionIdentifier"};
inline constexpr DicomTag kSliceLocation{0x00201041, "SliceLocation"};
inline constexpr DicomTag kTriggerDelay{0x00209153, "TriggerDelayTime"};
inline constexpr DicomTag kCardiacPhase{0x00209241, "NominalPercentageOfCardiacPhase"};
inline constexpr DicomTag kTimeIndex{0x00209128, "TemporalPositionIndex"};
inline constexpr DicomTag kSamples{0x00280002, "SamplesPerPixel"};
inline constexpr DicomTag kPhotometric{0x00280004, "PhotometricInterpretation"};
inline constexpr DicomTag kFrames{0x00280008, "NumberOfFrames"};
inline constexpr DicomTag kRows{0x00280010, "Rows"};
inline constexpr DicomTag kColumns{0x00280011, "Columns"};
inline constexpr DicomTag kPixelSpacing{0x00280030, "PixelSpacing"};
inline constexpr DicomTag kBits{0x00280100, "BitsAllocated"};
inline constexpr DicomTag kBitsStored{0x00280101, "BitsStored"};
inline constexpr DicomTag kHighBit{0x00280102, "HighBit"};
inline constexpr DicomTag kSign{0x00280103, "PixelRepresentation"};
inline constexpr DicomTag kPadding{0x00280120, "PixelPaddingValue"};
inline constexpr DicomTag kPaddingLimit{0x00280121, "PixelPaddingRangeLimit"};
inline constexpr DicomTag kWindowLevel{0x00281050, "WindowCenter"};
inline constexpr DicomTag kWindowWidth{0x00281051, "WindowWidth"};
inline constexpr DicomTag kIntercept{0x00281052, "RescaleIntercept"};
inline constexpr DicomTag kSlope{0x00281053, "RescaleSlope"};
inline constexpr DicomTag kRescaleType{0x00281054, "RescaleType"};
}  // namespace dicom

// A Modality LUT: what stored values stand for. Values before the first and behind the last entry
// count as these.
struct DicomTable {
  std::int64_t first = 0;              // the stored value of the first entry
  std::vector<std::uint16_t> entries;  // at least one
  std::string type;                    // ModalityLUTType: HU, US (unspecified), OD, ...
};

// What a compressed stream says of its pixels. Bits 0: not known, or not compressed.
struct DicomStream {
  int bits = 0;
  bool is_jpeg_2000 = false;
  bool is_signed = false;  // of JPEG 2000; the others do not say
};

struct DicomFile {
  bool is_dicom = false;    // has the preamble, or begins as files without one do
  bool has_pixels = false;  // is an image
  std::string syntax;       // TransferSyntaxUID; empty: not stated
  bool big_endian = false;
  bool is_encoded_otherwise = false;  // than the syntax states; it was read as it is
  bool has_fragments = false;         // the pixels are compressed: items, up to a delimiter
  bool has_bytes = false;             // the pixels are bytes (OB), whose order is never swapped
  bool has_frame_groups = false;      // an enhanced image: places and more are stated by frame
  DicomStream stream;
  // The pixels in the file; 0 without pixels. Padding may follow.
  std::int64_t pixels_begin = 0;
  std::int64_t pixels_end = 0;
  // By tag number, as text: numbers in decimal, several separated by '\'.
  std::map<std::uint32_t, std::string> values;
  std::shared_ptr<const DicomTable> table;  // may be null

  std::string Text(const DicomTag& tag) const {
    const auto value = values.find(tag.number);
    return value == values.end() ? std::string() : value->second;
  }
};

// `length`: the bytes of the stream. Refuses files that are truncated or contradict themselves, and
// those whose pixels are of a kind that is not supported: it names the kind.
DicomFile CheckDicomFile(std::istream* in, std::int64_t length);

}  // namespace palpate
