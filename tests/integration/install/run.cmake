# Installs the SDK to a staging folder, builds the consumer against it, and runs it.
#   cmake -DGENERATOR=... -DBUILD_DIR=... -DSOURCE_DIR=... -DSTAGE_DIR=... -P run.cmake
function(run)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "failed (${result}): ${ARGN}")
  endif()
endfunction()

file(REMOVE_RECURSE ${STAGE_DIR})
run(${CMAKE_COMMAND} --install ${BUILD_DIR} --component sdk --prefix ${STAGE_DIR}/prefix)
run(${CMAKE_COMMAND} -G ${GENERATOR} -S ${SOURCE_DIR}/consumer -B ${STAGE_DIR}/build -DCMAKE_PREFIX_PATH=${STAGE_DIR}/prefix)
run(${CMAKE_COMMAND} --build ${STAGE_DIR}/build)
run(${STAGE_DIR}/build/consumer)
