// Where the keepers of cells have their books (cell_keeper.h).
#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "lcmtypes/bus/lock_file.h"
#include "planner_daemon/coordination/cell_keeper.h"

namespace swarm {

class BookStore {
 public:
  virtual ~BookStore() = default;
  virtual std::vector<CellKeeper::Book> load() = 0;
  // False when it could not be saved; what was saved before of that cell is then still there.
  [[nodiscard]] virtual bool save(const CellKeeper::Book& book) = 0;
};

// Outlives the node, not the process.
class MemoryBookStore : public BookStore {
 public:
  std::vector<CellKeeper::Book> load() override;
  bool save(const CellKeeper::Book& book) override;

 private:
  std::map<Cell, CellKeeper::Book> books_;
};

// A file for each cell in which anybody ever was, replaced as a whole. It is in a directory that was made for books of
// cells of one size: what is missing there was never written, and what is damaged is not begun anew, as robots may fly
// that it knew of. Nobody else can have it at the same time.
class FileBookStore : public BookStore {
 public:
  // Makes the directory, if there is none yet: only while no robot flies in any of the cells. Throws
  // std::runtime_error with path and reason.
  static void begin(const std::filesystem::path& directory, double cell_m);

  // Throws std::runtime_error with path and reason: it is no such directory, or of cells of another size, or another
  // has it.
  FileBookStore(const std::filesystem::path& directory, double cell_m);

  // Throws std::runtime_error with the path of what is no whole book.
  std::vector<CellKeeper::Book> load() override;
  bool save(const CellKeeper::Book& book) override;

 private:
  std::filesystem::path directory_;
  LockFile lock_;
};

// A book as text, and back; throws std::runtime_error that says what is wrong with it.
std::string text_of_book(const CellKeeper::Book& book);
CellKeeper::Book read_book(const std::string& text);

}  // namespace swarm
