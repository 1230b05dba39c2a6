// A window that shows pictures and reads keys and mouse.
#pragma once

#include <memory>
#include <string>

#include "play/keyboard.h"
#include "report/scene.h"

namespace cale {

/// The window of `cale play`.
class Window {
  public:
    /// For pictures of width x height pixels; `dial` is the position of the joystick in them. Throws
    /// std::runtime_error with the reason if there is no display, or this build has no windows.
    Window(int width, int height, const Dial& dial);
    ~Window();
    Window(Window&&) noexcept;
    Window& operator=(Window&&) noexcept;

    /// Throws std::invalid_argument for a picture of another size.
    void show(const Image& picture, const std::string& title);
    /// Reads the player's input since the last call. Returns the last command; closing the window is
    /// Command::quit.
    Command poll(Hands& hands);

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
