#include <itkImage.h>
#include <itkImageFileReader.h>
#include <itkMetaImageIO.h>

#include <type_traits>

#include "server/import/readers.h"

namespace palpate {
namespace {

// ITK must read the header as we do; otherwise our checks would be useless. ITK converts the voxels
// to floats, but must not convert them to another integer type.
template <class Voxel>
void CheckAgreement(const itk::ImageIOBase& io, const ImageHeader& header) {
  bool agrees = io.GetNumberOfComponents() == 1 && io.GetNumberOfDimensions() >= 3 &&
                (std::is_same_v<Voxel, float> ||
                 io.GetComponentType() == itk::ImageIOBase::MapPixelType<Voxel>::CType);
  for (unsigned k = 0; agrees && k < io.GetNumberOfDimensions(); ++k) {
    agrees = io.GetDimensions(k) == (k < 3 ? static_cast<std::size_t>(header.size[k]) : 1);
  }
  if (!agrees) Refuse("the header is ambiguous; save the volume again with another program");
}

template <class Image>
void CopyGeometry(const Image& image, VolumeMetadata* metadata) {
  for (unsigned row = 0; row < 3; ++row) {
    metadata->size[row] = static_cast<int>(image.GetLargestPossibleRegion().GetSize(row));
    metadata->spacing_mm[row] = image.GetSpacing()[row];
    metadata->origin_W_mm[row] = image.GetOrigin()[row];
    for (unsigned col = 0; col < 3; ++col) {
      metadata->direction(row, col) = image.GetDirection()(row, col);
    }
  }
}

template <class Voxel>
VolumeMetadata ReadChecked(const std::filesystem::path& path, const ImageHeader& header,
                           const VoxelSink& sink, Reporter* reporter) {
  using Image = itk::Image<Voxel, 3>;
  const auto io = itk::MetaImageIO::New();
  const auto reader = itk::ImageFileReader<Image>::New();
  reader->SetImageIO(io);
  reader->SetFileName(path.string());
  reader->UpdateOutputInformation();
  CheckAgreement<Voxel>(*io, header);
  reporter->Progress(0.2, "reading");
  reader->Update();

  const Image& image = *reader->GetOutput();
  sink(kLeafTypeOf<Voxel>, image.GetBufferPointer(), image.GetBufferedRegion().GetNumberOfPixels());
  VolumeMetadata metadata;
  CopyGeometry(image, &metadata);
  if (header.geometry.is_lps) metadata.patient_axes = "LPS";
  metadata.unit = header.unit;
  metadata.original_type = Name(header.type);
  return metadata;
}

}  // namespace

VolumeMetadata ReadMetaImageVolume(const std::filesystem::path& path, const ImportLimits& limits,
                                   const VoxelSink& sink, Reporter* reporter) {
  reporter->Progress(0.0, "checking");
  const ImageHeader header = ReadCheckedHeader(path, ImageFormat::kMetaImage, limits);
  return VisitType(ReadType(header), [&](auto voxel) {
    return ReadChecked<decltype(voxel)>(path, header, sink, reporter);
  });
}

}  // namespace palpate
