find_package(TIFF REQUIRED)
find_package(ZLIB REQUIRED)
palpate_integration_test(import_test import_test.cpp
  palpate::volume TIFF::TIFF ZLIB::ZLIB)
palpate_test(offline import_data_test import_data_test.cpp
  palpate::volume)
foreach(test import_test import_data_test)
  add_dependencies(${test} palpate-import)
  target_sources(${test} PRIVATE ${CMAKE_CURRENT_LIST_DIR}/import_support.cpp)
  target_compile_definitions(${test} PRIVATE
    PALPATE_IMPORT="$<TARGET_FILE:palpate-import>"
    PALPATE_DATA_DIR="${PALPATE_DATA_DIR}")
endforeach()
target_sources(import_test PRIVATE
  ${CMAKE_CURRENT_LIST_DIR}/import_dicom_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/import_formats_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/import_process_test.cpp
  ${CMAKE_CURRENT_LIST_DIR}/import_vdb_test.cpp)
