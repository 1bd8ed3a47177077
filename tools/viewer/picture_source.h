// Where a browser's picture comes from: the buses as they are, or a log.
#pragma once

#include "tools/viewer/picture_frame.h"

namespace swarm {

class PictureSource {
 public:
  virtual ~PictureSource() = default;

  struct Moment {
    const SwarmPicture& picture;
    Utime utime;  // that it is of
  };
  virtual Moment now() = 0;
  // For the page: {"mode": ...} and what is special to it.
  virtual Json describe() = 0;
  // Whose map is looked at; -1: nobody's.
  virtual void select(int /*robot*/) {}
  // What the page wants of it. Throws std::runtime_error, one line, when it cannot have it.
  virtual void control(const Json& command) = 0;
};

}  // namespace swarm
