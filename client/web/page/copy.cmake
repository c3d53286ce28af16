# cmake -DSOURCE=... -DCOPY=... -P copy.cmake: copies the page, the shaders and the page's tests to
# COPY, where node_modules is, so that they find packages by name.
file(REMOVE_RECURSE ${COPY}/client ${COPY}/tests)
file(COPY ${SOURCE}/client/web/page DESTINATION ${COPY}/client/web
  PATTERN node_modules EXCLUDE PATTERN dist EXCLUDE)
file(COPY ${SOURCE}/LICENSE DESTINATION ${COPY})
file(COPY ${SOURCE}/client/shading DESTINATION ${COPY}/client FILES_MATCHING PATTERN "*.glsl")
file(COPY ${SOURCE}/tests/web DESTINATION ${COPY}/tests)
