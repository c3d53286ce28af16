palpate_unit_test(import_headers_test import_headers_test.cpp CORE palpate::import_headers)
palpate_unit_test(import_nifti_header_test import_nifti_header_test.cpp
  CORE palpate::import_headers)
find_package(TIFF REQUIRED)
palpate_unit_test(import_tiff_test import_tiff_test.cpp
  CORE palpate::import_headers TIFF::TIFF)
palpate_unit_test(import_voxels_test import_voxels_test.cpp CORE palpate::import_headers)
