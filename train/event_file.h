// TensorBoard event files: records framed with checksums, each a serialised Event (tensorboard_event.proto).
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "storage/append_file.h"

namespace cale {

/// One TFRecord: length, its masked checksum, the bytes, their masked checksum.
std::string tf_record(std::string_view bytes);

/// A new file `events.out.tfevents.<unix time>.<host>.<pid>.<n>` in the run's folder;
/// TensorBoard shows all such files of a folder as one run. Every record reaches the
/// file at once. Throws std::runtime_error when the disk is full, the file unwritable, or a
/// text is not UTF-8: its record is not written then.
class EventFile {
  public:
    /// `resumed_step`: the run continues from this step, and whatever an earlier session
    /// recorded for later ones is void.
    explicit EventFile(const std::filesystem::path& folder,
                       std::optional<std::int64_t> resumed_step = std::nullopt);

    /// Tag ("losses/qf_loss") -> value, which TensorBoard keeps as float32.
    void write(std::int64_t global_step, const std::map<std::string, double>& scalars);

    /// Name -> value, shown as a table under TEXT > hyperparameters.
    void write_hyperparameters(std::span<const std::pair<std::string, std::string>> values);

    const std::filesystem::path& path() const { return file_.path(); }

  private:
    AppendFile file_;
};

}  // namespace cale
