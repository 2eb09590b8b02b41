include(${CMAKE_CURRENT_LIST_DIR}/FlexgramDependencies.cmake)
include(${CMAKE_CURRENT_LIST_DIR}/flexgramTargets.cmake)
