# LCM and libsodium as targets, which their packages have none of: for the build, and for programs of others that link the
# installed libraries.
find_path(SWARM_LCM_INCLUDE_DIR lcm/lcm_coretypes.h REQUIRED)
find_library(SWARM_LCM_LIBRARY lcm REQUIRED)
find_path(SWARM_SODIUM_INCLUDE_DIR sodium.h REQUIRED)
find_library(SWARM_SODIUM_LIBRARY sodium REQUIRED)
foreach(library lcm sodium)
  string(TOUPPER ${library} LIBRARY)
  if(NOT TARGET sogm_swarm::${library})
    add_library(sogm_swarm::${library} UNKNOWN IMPORTED)
    set_target_properties(sogm_swarm::${library} PROPERTIES
      IMPORTED_LOCATION ${SWARM_${LIBRARY}_LIBRARY} INTERFACE_INCLUDE_DIRECTORIES ${SWARM_${LIBRARY}_INCLUDE_DIR})
  endif()
endforeach()
