# cmake --install BUILD --component palpate-client: the library, its headers, and what
# find_package(palpate-client) reads.
include(CMakePackageConfigHelpers)

file(GLOB contract CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/common/contract/*.h)
# None of them includes gRPC or protobuf: unit.include_layers checks it.
target_sources(palpate_client PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR} FILES
  activity.h calls.h client.h connection.h device.h download.h edit.h facts.h hand_lead.h nrrd_file.h placement.h pose.h pose_reader.h progress.h
  recording.h series.h server_choice.h setting.h setting_list.h settings.h volume.h volume_mirror.h volume_update.h words.h
  ${PROJECT_SOURCE_DIR}/common/bricks/brick.h
  ${PROJECT_SOURCE_DIR}/common/bricks/brick_map.h
  ${PROJECT_SOURCE_DIR}/common/bricks/leaf_type.h
  ${PROJECT_SOURCE_DIR}/common/bricks/typed_brick.h
  ${PROJECT_SOURCE_DIR}/common/bricks/volume_event.h
  ${contract}
  ${PROJECT_SOURCE_DIR}/common/error/error.h
  ${PROJECT_SOURCE_DIR}/common/geometry/geometry.h)
target_compile_features(palpate_client PUBLIC cxx_std_20)

set(names client)
# What the client is linked with: palpate::client brings them along.
list(APPEND names address bricks error files geometry isosurface messages proto contract volume_copy volume_mirror wire)
foreach(name IN LISTS names)
  set_target_properties(palpate_${name} PROPERTIES EXPORT_NAME ${name})
  list(APPEND targets palpate_${name})
endforeach()
# Names of files among all others in a library folder.
foreach(name IN LISTS names)
  get_target_property(type palpate_${name} TYPE)
  if(type STREQUAL STATIC_LIBRARY)
    set_target_properties(palpate_${name} PROPERTIES OUTPUT_NAME palpate-${name})
  endif()
endforeach()

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/palpate-client)
install(TARGETS ${targets} EXPORT palpate-client COMPONENT palpate-client
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR}/palpate
  FILE_SET HEADERS DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/palpate COMPONENT palpate-client)
install(EXPORT palpate-client NAMESPACE palpate:: FILE palpate-client-targets.cmake
  DESTINATION ${package} COMPONENT palpate-client)
write_basic_package_version_file(
  ${CMAKE_CURRENT_BINARY_DIR}/palpate-client-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES palpate-client-config.cmake
  ${CMAKE_CURRENT_BINARY_DIR}/palpate-client-config-version.cmake
  DESTINATION ${package} COMPONENT palpate-client)
