# Debian packages, one for each component: `cmake --build build --target packages_ready`,
# then `cpack` in build. tests/packages_test.sh builds, checks and installs them.
find_program(HELP2MAN help2man)
find_program(GZIP gzip)
find_program(STRIP_PROGRAM strip)

# Without building the tests first.
set(CMAKE_SKIP_INSTALL_ALL_DEPENDENCY ON)
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME palpate)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_DEBIAN_PACKAGE_RELEASE 1)
# There is no list yet, and a domain of others would get their mail: RFC 2606 keeps
# .invalid from ever being one. Who distributes the packages sets their own.
set(PALPATE_MAINTAINER "The Palpate authors <palpate@lists.invalid>" CACHE STRING
  "Who answers for the packages: NAME <ADDRESS>")
set(CPACK_DEBIAN_PACKAGE_MAINTAINER ${PALPATE_MAINTAINER})
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
  OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_COMPONENTS_ALL "")

set(manuals_folder ${CMAKE_BINARY_DIR}/manuals)
file(MAKE_DIRECTORY ${manuals_folder})
add_custom_target(manuals)
# All that they hold.
add_custom_target(packages_ready DEPENDS manuals palpate_client palpate_python)

# palpate_package(COMPONENT PACKAGE SECTION DESCRIPTION): one package, with what every
# package has. The first line of the description is its synopsis.
macro(palpate_package component package section description)
  list(APPEND CPACK_COMPONENTS_ALL ${component})
  string(TOUPPER ${component} upper)
  set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${package})
  set(CPACK_DEBIAN_${upper}_PACKAGE_SECTION ${section})
  set(CPACK_DEBIAN_${upper}_DESCRIPTION "${description}")
  set(CPACK_COMPONENT_${upper}_DESCRIPTION "${description}")
  set(doc ${CMAKE_INSTALL_DATADIR}/doc/${package})
  install(FILES ${PROJECT_SOURCE_DIR}/deploy/debian/copyright
    DESTINATION ${doc} COMPONENT ${component})
  # -n: the same bytes in every build.
  set(changelog ${CMAKE_BINARY_DIR}/manuals/${package}/changelog.Debian.gz)
  file(MAKE_DIRECTORY ${CMAKE_BINARY_DIR}/manuals/${package})
  set(changelog_package ${package})
  configure_file(${PROJECT_SOURCE_DIR}/deploy/debian/changelog.in
    ${CMAKE_BINARY_DIR}/manuals/${package}/changelog.Debian @ONLY)
  add_custom_command(OUTPUT ${changelog}
    COMMAND ${GZIP} -9nkf changelog.Debian
    DEPENDS ${CMAKE_BINARY_DIR}/manuals/${package}/changelog.Debian
    WORKING_DIRECTORY ${CMAKE_BINARY_DIR}/manuals/${package} VERBATIM)
  add_custom_target(changelog_${component} DEPENDS ${changelog})
  add_dependencies(manuals changelog_${component})
  # Not there where the library alone is installed, from a tree without manuals.
  install(FILES ${changelog} DESTINATION ${doc} COMPONENT ${component} OPTIONAL)
endmacro()

# palpate_program(COMPONENT TARGET ABOUT): a program with its manual, which is its --help.
function(palpate_program component target about)
  install(TARGETS ${target} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT ${component})
  set(manual ${manuals_folder}/${target}.1)
  add_custom_command(OUTPUT ${manual}.gz
    COMMAND ${HELP2MAN} --no-info --no-discard-stderr --section=1 --name=${about}
      --output=${manual} $<TARGET_FILE:${target}>
    COMMAND ${GZIP} -9nf ${manual}
    DEPENDS ${target} VERBATIM)
  add_custom_target(manual_${target} DEPENDS ${manual}.gz)
  add_dependencies(manuals manual_${target})
  install(FILES ${manual}.gz DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT ${component})
endfunction()

# --- palpate-daemon ---------------------------------------------------------------
palpate_package(daemon palpate-daemon science
"Feel an isosurface of a volume with a force-feedback stylus
palpated runs the 1 kHz haptic loop of a force-feedback stylus on an isosurface
of a volume (CT, MRI, microscopy, simulation) and serves viewers and scripts
over gRPC. With the importer that it runs, palpate-lab for offline work, and a
systemd service with real-time rights.")
palpate_program(daemon palpated "haptics daemon")
palpate_program(daemon palpate-import "converts volumes for palpated")
palpate_program(daemon palpate-lab "offline experiments with isosurfaces that are felt")
install(FILES deploy/config/palpated.toml DESTINATION /etc/palpate COMPONENT daemon)
install(FILES deploy/systemd/palpated.service
  DESTINATION /lib/systemd/system COMPONENT daemon)
install(FILES deploy/systemd/palpate.sysusers
  DESTINATION lib/sysusers.d RENAME palpate.conf COMPONENT daemon)
install(FILES deploy/udev/70-palpate.rules DESTINATION lib/udev/rules.d COMPONENT daemon)
# The guides lie as in the source, so that links between them work.
set(doc ${CMAKE_INSTALL_DATADIR}/doc/palpate-daemon)
install(FILES README.md DESTINATION ${doc} COMPONENT daemon)
install(DIRECTORY deploy/guides DESTINATION ${doc}/deploy COMPONENT daemon
  FILES_MATCHING PATTERN "*.md" PATTERN "*.png" PATTERN "*.svg")
set(CPACK_DEBIAN_DAEMON_PACKAGE_SHLIBDEPS ON)
# The user is made by systemd-sysusers, the service by systemd; procps: /usr/bin/kill,
# without which the unit's sandbox is not set up.
set(CPACK_DEBIAN_DAEMON_PACKAGE_DEPENDS "systemd, init-system-helpers (>= 1.54), procps")
set(CPACK_DEBIAN_DAEMON_PACKAGE_SUGGESTS "palpate-client")
set(CPACK_DEBIAN_DAEMON_PACKAGE_CONTROL_EXTRA
  ${PROJECT_SOURCE_DIR}/deploy/debian/daemon/conffiles
  ${PROJECT_SOURCE_DIR}/deploy/debian/daemon/postinst
  ${PROJECT_SOURCE_DIR}/deploy/debian/daemon/prerm
  ${PROJECT_SOURCE_DIR}/deploy/debian/daemon/postrm)
set(CPACK_DEBIAN_DAEMON_PACKAGE_CONTROL_STRICT_PERMISSION ON)

# --- palpate-client ---------------------------------------------------------------
palpate_package(cli palpate-client science
"Command line client of palpated
Watches and steers palpated, the daemon that makes a volume's isosurface felt:
isovalue and other settings, volumes up and down, edits, recordings, devices.
`palpate doctor` says whether a workstation is fit for the haptic loop.")
palpate_program(cli palpate "steers and watches palpated")
set(completion ${manuals_folder}/palpate.bash)
add_custom_command(OUTPUT ${completion}
  COMMAND $<TARGET_FILE:palpate> completion > ${completion} DEPENDS palpate VERBATIM)
add_custom_target(completion_palpate DEPENDS ${completion})
add_dependencies(manuals completion_palpate)
install(FILES ${completion} DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions
  RENAME palpate COMPONENT cli)
set(CPACK_DEBIAN_CLI_PACKAGE_SHLIBDEPS ON)

# --- palpate-viewer ---------------------------------------------------------------
if(TARGET palpate-view)
  palpate_package(viewer palpate-viewer science
"Viewer of what palpated makes felt
Shows the volume of a palpated, near or far, with the stylus that feels it.")
  palpate_program(viewer palpate-view "shows what palpated makes felt")
  install(FILES deploy/debian/viewer/palpate-view.desktop
    DESTINATION ${CMAKE_INSTALL_DATADIR}/applications COMPONENT viewer)
  set(CPACK_DEBIAN_VIEWER_PACKAGE_SHLIBDEPS ON)
  # Loaded at run time; without a graphics card's driver Mesa draws.
  set(CPACK_DEBIAN_VIEWER_PACKAGE_DEPENDS "libegl1, libgl1")
  # The start page starts a palpated; one of the three is the dialog for files.
  set(CPACK_DEBIAN_VIEWER_PACKAGE_RECOMMENDS
    "libgl1-mesa-dri, fonts-dejavu-core, palpate-daemon, zenity | kdialog | yad")
endif()

# --- palpate-web ------------------------------------------------------------------
# Not without its page: see PALPATE_WEB_PAGE.
if(TARGET palpate_web_page)
  palpate_package(web palpate-web science
"Shows guests in a browser what palpated makes felt
A gateway between one palpated, near or far, and the browsers of guests: the
volume, the surface, the stylus and the forces, live. Guests watch; named users
may change named settings. Several gateways, also at other sites, show one
palpated over NATS. With a systemd service, which is not enabled until
an administrator has said who may watch.")
  palpate_program(web palpate-web "serves guests' browsers")
  get_target_property(page palpate_web_page PALPATE_FOLDER)
  add_dependencies(packages_ready palpate_web_page)
  install(CODE "
    if(NOT EXISTS \"${page}/app.js\")
      message(FATAL_ERROR \"palpate-web: build its page first: the target palpate_web_page\")
    endif()" COMPONENT web)
  install(DIRECTORY ${page}/ DESTINATION ${CMAKE_INSTALL_DATADIR}/palpate/web COMPONENT web)
  install(FILES deploy/config/palpate-web.toml DESTINATION /etc/palpate COMPONENT web)
  install(FILES deploy/systemd/palpate-web.service DESTINATION /lib/systemd/system COMPONENT web)
  install(FILES deploy/systemd/palpate-web.sysusers
    DESTINATION lib/sysusers.d RENAME palpate-web.conf COMPONENT web)
  # For nats-server, which an administrator sets up: the guide nats.md.
  install(FILES deploy/nats/hub.conf deploy/nats/leaf.conf deploy/nats/service.conf
    DESTINATION ${CMAKE_INSTALL_DATADIR}/palpate/nats COMPONENT web)
  set(CPACK_DEBIAN_WEB_PACKAGE_SHLIBDEPS ON)
  set(CPACK_DEBIAN_WEB_PACKAGE_DEPENDS "systemd, init-system-helpers (>= 1.54)")
  set(CPACK_DEBIAN_WEB_PACKAGE_SUGGESTS "palpate-daemon, nats-server")
  set(CPACK_DEBIAN_WEB_PACKAGE_CONTROL_EXTRA
    ${PROJECT_SOURCE_DIR}/deploy/debian/web/conffiles
    ${PROJECT_SOURCE_DIR}/deploy/debian/web/postinst
    ${PROJECT_SOURCE_DIR}/deploy/debian/web/prerm
    ${PROJECT_SOURCE_DIR}/deploy/debian/web/postrm)
  set(CPACK_DEBIAN_WEB_PACKAGE_CONTROL_STRICT_PERMISSION ON)
endif()

# --- python3-palpate --------------------------------------------------------------
palpate_package(python python3-palpate python
"Python client of palpated
Poses of a force-feedback stylus as NumPy arrays, settings as attributes,
edits, recordings, and volumes up and down: a client of palpated, the daemon
that makes a volume's isosurface felt.")
install(DIRECTORY ${PALPATE_PYTHON_FOLDER}/palpate
  DESTINATION lib/python3/dist-packages COMPONENT python
  PATTERN __pycache__ EXCLUDE)
set(CPACK_DEBIAN_PYTHON_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
  "python3 (>= 3.11), python3-grpcio, python3-numpy, python3-protobuf, python3-xxhash, python3-zstandard")
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA
  ${PROJECT_SOURCE_DIR}/deploy/debian/python/postinst
  ${PROJECT_SOURCE_DIR}/deploy/debian/python/prerm)
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_STRICT_PERMISSION ON)

# --- libpalpate-client-dev --------------------------------------------------------
# The component of client/sdk/install.cmake.
palpate_package(palpate-client libpalpate-client-dev libdevel
"C++ client library of palpated
Static library, headers and CMake configuration for programs that show or steer
what palpated makes felt: find_package(palpate-client).")
set(CPACK_DEBIAN_PALPATE-CLIENT_PACKAGE_DEPENDS
  "libgrpc++-dev, libprotobuf-dev, protobuf-compiler-grpc, libeigen3-dev, libtomlplusplus-dev, libxxhash-dev, libzstd-dev, zlib1g-dev, pkg-config")
# Its debug information holds the build machine's paths, and is most of its size.
install(CODE "
  file(GLOB archives \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${CMAKE_INSTALL_LIBDIR}/palpate/*.a\")
  if(archives AND CMAKE_INSTALL_DO_STRIP)
    execute_process(COMMAND ${STRIP_PROGRAM} --strip-debug --enable-deterministic-archives \${archives}
      COMMAND_ERROR_IS_FATAL ANY)
  endif()" COMPONENT palpate-client)

include(CPack)
