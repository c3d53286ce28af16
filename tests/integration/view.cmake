foreach(test view_live_test view_brush_test)
  palpate_integration_test(${test} ${test}.cpp palpate::view_live)
  add_dependencies(${test} palpated)
  target_compile_definitions(${test} PRIVATE PALPATED="$<TARGET_FILE:palpated>")
endforeach()
pkg_check_modules(EPOXY REQUIRED IMPORTED_TARGET epoxy)
find_package(ZLIB REQUIRED)

# PALPATE_DATA_DIR is import.cmake's.
palpate_test(offline view_surface_test view_surface_test.cpp
  palpate::view_render palpate::error PkgConfig::EPOXY ZLIB::ZLIB)
target_compile_definitions(view_surface_test PRIVATE PALPATE_DATA_DIR="${PALPATE_DATA_DIR}")
palpate_test(offline view_surface_values_test view_surface_values_test.cpp
  palpate::view_render palpate::error PkgConfig::EPOXY ZLIB::ZLIB)
palpate_test(offline view_volume_texture_test view_volume_texture_test.cpp
  palpate::view_render palpate::error PkgConfig::EPOXY ZLIB::ZLIB)
pkg_check_modules(EPOXY REQUIRED IMPORTED_TARGET epoxy)

# OpenGL without a display, in software where there is no graphics card.
palpate_integration_test(view_frame_test view_frame_test.cpp
  palpate::view_render palpate::error PkgConfig::EPOXY)
palpate_test(offline view_slice_test view_slice_test.cpp
  palpate::view_render palpate::error PkgConfig::EPOXY)

# palpate-view against the real daemon, seen by the Python package.
foreach(test view_offscreen_test view_panels_test view_run_test view_window_test)
  add_test(NAME integration.${test}
    COMMAND ${PALPATE_PYTHON} -m run_tests ${test} WORKING_DIRECTORY ${CMAKE_CURRENT_LIST_DIR})
  set_tests_properties(integration.${test} PROPERTIES
    LABELS integration
    COST 50  # long ones: early
    TIMEOUT 600
    ENVIRONMENT "PYTHONPATH=${PALPATE_PYTHON_FOLDER}:${PROJECT_SOURCE_DIR}/tests/support:\
${PROJECT_SOURCE_DIR}/tests/python;PYTHONDONTWRITEBYTECODE=1;PALPATED=$<TARGET_FILE:palpated>;PALPATE=$<TARGET_FILE:palpate>;\
PALPATE_VIEW=$<TARGET_FILE:palpate-view>")
endforeach()

if(PALPATE_SANITIZE)
  foreach(program palpate-view view_frame_test view_slice_test view_live_test view_brush_test
          view_surface_test view_surface_values_test view_volume_texture_test)
    target_sources(${program} PRIVATE ${PROJECT_SOURCE_DIR}/tests/support/kept_libraries.cpp)
  endforeach()
endif()
