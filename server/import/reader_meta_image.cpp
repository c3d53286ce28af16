#include <itkImage.h>
#include <itkImageFileReader.h>
#include <itkMetaImageIO.h>

#include "server/import/readers.h"

namespace palpate {
namespace {

using Image = itk::Image<float, 3>;

// ITK must read the header as we do; otherwise our checks would be useless.
void CheckAgreement(const itk::ImageIOBase& io, const ImageHeader& header) {
  bool agrees = io.GetNumberOfComponents() == 1 && io.GetNumberOfDimensions() >= 3;
  for (unsigned k = 0; agrees && k < io.GetNumberOfDimensions(); ++k) {
    agrees = io.GetDimensions(k) == (k < 3 ? static_cast<std::size_t>(header.size[k]) : 1);
  }
  if (!agrees) Refuse("the header is ambiguous; save the volume again with another program");
}

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

}  // namespace

DenseVolume ReadMetaImageVolume(const std::filesystem::path& path, const ImportLimits& limits,
                                Reporter* reporter) {
  reporter->Progress(0.0, "checking");
  const ImageHeader header = ReadCheckedHeader(path, ImageFormat::kMetaImage, limits);

  const auto io = itk::MetaImageIO::New();
  const auto reader = itk::ImageFileReader<Image>::New();
  reader->SetImageIO(io);
  reader->SetFileName(path.string());
  reader->UpdateOutputInformation();
  CheckAgreement(*io, header);
  reporter->Progress(0.2, "reading");
  reader->Update();

  const Image::Pointer image = reader->GetOutput();
  DenseVolume volume;
  CopyGeometry(*image, &volume.metadata);
  volume.metadata.unit = header.unit;
  volume.metadata.original_type = Name(header.type);
  // Ownership moves without a copy: the buffer may have gigabytes.
  volume.voxels.reset(image->GetBufferPointer());
  image->GetPixelContainer()->ContainerManageMemoryOff();
  return volume;
}

}  // namespace palpate
