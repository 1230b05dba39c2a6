// A file that is either complete and undamaged, or rejected: zstd with a checksum, written to a temporary
// name, synced and renamed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

struct ZSTD_CCtx_s;
struct ZSTD_DCtx_s;

namespace cale {

struct CloseFile {
    void operator()(std::FILE* file) const { std::fclose(file); }
};
using FileHandle = std::unique_ptr<std::FILE, CloseFile>;

/// Writes `path` + ".tmp" and renames it in commit(), after syncing its content; the name is durable only
/// once the folder has been synced. Without commit() nothing remains. Every member throws std::runtime_error,
/// naming the file, when writing fails: std::system_error where the system refuses it.
class ReplayFileWriter {
  public:
    /// `magic`: eight characters that identify the kind of file.
    ReplayFileWriter(const std::string& path, std::string_view magic, std::uint32_t version);
    ~ReplayFileWriter();
    ReplayFileWriter(const ReplayFileWriter&) = delete;
    ReplayFileWriter& operator=(const ReplayFileWriter&) = delete;

    void write(const void* data, std::size_t size);
    void commit();
    [[noreturn]] void fail(const std::string& what) const;

  private:
    [[noreturn]] void fail_as_the_system_says() const;  // by errno

    struct FreeContext {
        void operator()(ZSTD_CCtx_s* context) const;
    };
    void compress(const void* data, std::size_t size, bool last);
    void write_raw(const void* data, std::size_t size);

    std::string path_, temporary_;
    FileHandle file_;
    std::unique_ptr<ZSTD_CCtx_s, FreeContext> context_;
    std::vector<char> compressed_;
};

/// Reads what ReplayFileWriter wrote, in pieces of any size. Every member throws std::runtime_error that
/// names the file and what is wrong with it. Its memory use does not depend on the file's contents. The
/// content is verified only after finish().
class ReplayFileReader {
  public:
    ReplayFileReader(const std::string& path, std::string_view magic, std::uint32_t version);

    void read(void* data, std::size_t size);
    void skip(std::size_t size);
    /// Checks that everything has been read, and verifies the checksum.
    void finish();
    [[noreturn]] void fail(const std::string& what) const;

  private:
    struct FreeContext {
        void operator()(ZSTD_DCtx_s* context) const;
    };
    [[noreturn]] void fail_as_the_system_says() const;  // by errno
    // Decompresses up to `size` bytes; fewer at the end of the content only.
    std::size_t decompress(void* data, std::size_t size);

    std::string path_;
    FileHandle file_;
    std::unique_ptr<ZSTD_DCtx_s, FreeContext> context_;
    std::vector<char> compressed_;
    std::size_t begin_ = 0, end_ = 0;  // the unread part of compressed_
    bool complete_ = false;            // the end of the content and its checksum were reached
};

}  // namespace cale
