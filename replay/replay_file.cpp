#include "replay/replay_file.h"

#include <unistd.h>
#include <zstd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <stdexcept>
#include <system_error>

namespace cale {
namespace {

constexpr int kCompressionLevel = 1;
constexpr int kWindowLog = 20;  // 1 MiB: over a hundred frames to find the last one in
constexpr std::size_t kMagicSize = 8;

std::string cannot_write(const std::string& path) {
    return "cannot write the replay to " + path;
}

std::string cannot_read(const std::string& path) {
    return "cannot read the replay from " + path;
}

}  // namespace

void ReplayFileWriter::FreeContext::operator()(ZSTD_CCtx_s* context) const {
    ZSTD_freeCCtx(context);
}
void ReplayFileReader::FreeContext::operator()(ZSTD_DCtx_s* context) const {
    ZSTD_freeDCtx(context);
}

ReplayFileWriter::ReplayFileWriter(const std::string& path, std::string_view magic, std::uint32_t version)
    : path_(path),
      temporary_(path + ".tmp"),
      file_(std::fopen(temporary_.c_str(), "wb")),
      context_(ZSTD_createCCtx()),
      compressed_(ZSTD_CStreamOutSize()) {
    if (!file_) fail_as_the_system_says();
    ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_compressionLevel, kCompressionLevel);
    ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_windowLog, kWindowLog);
    ZSTD_CCtx_setParameter(context_.get(), ZSTD_c_checksumFlag, 1);
    write_raw(magic.data(), kMagicSize);
    write_raw(&version, sizeof version);
}

ReplayFileWriter::~ReplayFileWriter() {
    if (!file_) return;
    file_.reset();
    std::remove(temporary_.c_str());
}

void ReplayFileWriter::write(const void* data, std::size_t size) {
    compress(data, size, false);
}

void ReplayFileWriter::commit() {
    compress(nullptr, 0, true);
    if (std::fflush(file_.get()) != 0 || ::fsync(::fileno(file_.get())) != 0) fail_as_the_system_says();
    if (std::rename(temporary_.c_str(), path_.c_str()) != 0) fail_as_the_system_says();
    file_.reset();
}

void ReplayFileWriter::compress(const void* data, std::size_t size, bool last) {
    ZSTD_inBuffer input{data, size, 0};
    for (;;) {
        ZSTD_outBuffer output{compressed_.data(), compressed_.size(), 0};
        const std::size_t left =
            ZSTD_compressStream2(context_.get(), &output, &input, last ? ZSTD_e_end : ZSTD_e_continue);
        if (ZSTD_isError(left) != 0) fail(ZSTD_getErrorName(left));
        write_raw(output.dst, output.pos);
        if (last ? left == 0 : input.pos == input.size) return;
    }
}

void ReplayFileWriter::write_raw(const void* data, std::size_t size) {
    if (size != 0 && std::fwrite(data, 1, size, file_.get()) != size) fail_as_the_system_says();
}

void ReplayFileWriter::fail(const std::string& what) const {
    throw std::runtime_error(cannot_write(path_) + ": " + what);
}

void ReplayFileWriter::fail_as_the_system_says() const {
    throw std::system_error(errno, std::generic_category(), cannot_write(path_));
}

ReplayFileReader::ReplayFileReader(const std::string& path, std::string_view magic, std::uint32_t version)
    : path_(path),
      file_(std::fopen(path.c_str(), "rb")),
      context_(ZSTD_createDCtx()),
      compressed_(ZSTD_DStreamInSize()) {
    if (!file_) fail_as_the_system_says();
    ZSTD_DCtx_setParameter(context_.get(), ZSTD_d_windowLogMax, kWindowLog);
    std::array<char, kMagicSize> found_magic{};
    std::uint32_t found_version = 0;
    const std::size_t read = std::fread(found_magic.data(), 1, kMagicSize, file_.get());
    if (std::ferror(file_.get()) != 0) fail_as_the_system_says();
    if (std::string_view(found_magic.data(), read) != magic.substr(0, read)) fail("it is not a replay file");
    if (read != kMagicSize || std::fread(&found_version, sizeof found_version, 1, file_.get()) != 1)
        fail("it is truncated");
    if (found_version != version)
        fail("its format is version " + std::to_string(found_version) + ", this program reads version " +
             std::to_string(version));
}

void ReplayFileReader::read(void* data, std::size_t size) {
    if (decompress(data, size) != size) fail("it ends too early");
}

void ReplayFileReader::skip(std::size_t size) {
    std::array<char, 4096> ignored{};
    for (; size > 0; size -= std::min(size, ignored.size()))
        read(ignored.data(), std::min(size, ignored.size()));
}

void ReplayFileReader::finish() {
    char extra = 0;
    if (decompress(&extra, 1) != 0 || begin_ != end_ || std::fgetc(file_.get()) != EOF)
        fail("it holds more than a replay");
}

std::size_t ReplayFileReader::decompress(void* data, std::size_t size) {
    ZSTD_outBuffer output{data, size, 0};
    while (output.pos < output.size && !complete_) {
        if (begin_ == end_) {
            begin_ = 0;
            end_ = std::fread(compressed_.data(), 1, compressed_.size(), file_.get());
            if (std::ferror(file_.get()) != 0) fail_as_the_system_says();
            if (end_ == 0) fail("it is truncated");
        }
        ZSTD_inBuffer input{compressed_.data(), end_, begin_};
        const std::size_t left = ZSTD_decompressStream(context_.get(), &output, &input);
        if (ZSTD_isError(left) != 0) fail(std::string("it is damaged (") + ZSTD_getErrorName(left) + ")");
        begin_ = input.pos;
        complete_ = left == 0;
    }
    return output.pos;
}

void ReplayFileReader::fail(const std::string& what) const {
    throw std::runtime_error(cannot_read(path_) + ": " + what);
}

void ReplayFileReader::fail_as_the_system_says() const {
    throw std::system_error(errno, std::generic_category(), cannot_read(path_));
}

}  // namespace cale
