// A window that shows pictures and listens to keys and mouse.
#pragma once

#include <memory>
#include <string>

#include "play/keyboard.h"
#include "report/scene.h"

namespace cale {

class Window {
  public:
    /// For pictures of width x height pixels; `dial` is where they have their joystick.
    /// Throws std::runtime_error that says why where there is no display, or this build has no windows.
    Window(int width, int height, const Dial& dial);
    ~Window();
    Window(Window&&) noexcept;
    Window& operator=(Window&&) noexcept;

    /// Throws std::invalid_argument for a picture of another size.
    void show(const Image& picture, const std::string& title);
    /// Takes in what the player has done since the last call. Returns the last command given;
    /// closing the window is one to quit.
    Command poll(Hands& hands);

  private:
    struct Impl;
    std::unique_ptr<Impl> impl_;
};

}  // namespace cale
