// See CMakeLists.txt: the precompiled header belongs to this file.
