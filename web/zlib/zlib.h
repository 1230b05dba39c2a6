// What ALE and cale/emulator.cpp use of zlib, which emscripten's sysroot does not have: checksums, and a ROM
// file read as it is, where zlib would also read a compressed one. Compression is there to be linked, and
// always fails: ALE needs it to write PNG files, of which the page writes none.
#pragma once

#include <cstdio>

using Bytef = unsigned char;
using uInt = unsigned int;
using uLong = unsigned long;
using uLongf = unsigned long;
using gzFile = std::FILE*;

inline constexpr int Z_OK = 0;
inline constexpr int Z_MEM_ERROR = -4;

/// Returns the CRC-32 of so many bytes behind those of which `crc` is; that is 0 at first.
uLong crc32(uLong crc, const Bytef* bytes, uInt count);

/// Returns Z_MEM_ERROR.
int compress(Bytef* to, uLongf* to_size, const Bytef* from, uLong from_size);

gzFile gzopen(const char* path, const char* mode);
/// Returns the bytes read.
int gzread(gzFile file, void* to, unsigned count);
int gzclose(gzFile file);
