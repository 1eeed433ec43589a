// What the programs that roll out worlds in other engines read and write (peers/rollout_program.py).
//
// They read requests from standard input and answer each on standard output until the input ends.
// Both are arrays of doubles in the machine's byte order, preceded by their length as a double.
//
// Request: the members of `Request` in their order, then
//   objects      (n_objects, 8)  shape (0 sphere, 1 box, 2 capsule), three dimensions in m (radius;
//                                edge lengths; radius and length), mass in kg, principal inertia
//   planes       (n_planes, 4)   unit normal and offset in m
//   coefficients (n_objects, n_objects + n_planes, 4)  of each pair: μ_s, μ_d, rolling arm in m, e
//   starts       (n_simulations, n_objects, 13)  position, quaternion (x, y, z, w), linear and
//                                angular velocity
// Answer: seconds, then positions (n_simulations, n_objects, n_steps, 3) after each step.
//
// The seconds are those of the simulation alone: setting the first states of each simulation,
// finding contacts, stepping, and writing the positions down.

#pragma once

#include <array>
#include <cstddef>
#include <cstdio>
#include <exception>
#include <stdexcept>
#include <vector>

enum ShapeCode { kSphere, kBox, kCapsule };

struct Request {
  int n_simulations, n_objects, n_planes, n_steps;
  std::array<bool, 2> flags;  // each program says what they choose
  double step;
  std::array<double, 3> gravity;
  const double *objects, *planes, *coefficients, *starts;
};

class Reader {
 public:
  explicit Reader(const std::vector<double>& data) : data_(data) {}

  const double* take(std::size_t count) {
    if (next_ + count > data_.size()) throw std::runtime_error("the request is too short");
    const double* at = data_.data() + next_;
    next_ += count;
    return at;
  }
  int integer() { return static_cast<int>(*take(1)); }
  bool flag() { return *take(1) != 0.0; }
  bool at_end() const { return next_ == data_.size(); }

 private:
  const std::vector<double>& data_;
  std::size_t next_ = 0;
};

inline Request parse(const std::vector<double>& data) {
  Reader reader(data);
  Request r{};
  r.n_simulations = reader.integer();
  r.n_objects = reader.integer();
  r.n_planes = reader.integer();
  r.n_steps = reader.integer();
  for (bool& flag : r.flags) flag = reader.flag();
  r.step = *reader.take(1);
  const double* gravity = reader.take(3);
  r.gravity = {gravity[0], gravity[1], gravity[2]};
  const std::size_t objects = r.n_objects, planes = r.n_planes, simulations = r.n_simulations;
  r.objects = reader.take(objects * 8);
  r.planes = reader.take(planes * 4);
  r.coefficients = reader.take(objects * (objects + planes) * 4);
  r.starts = reader.take(simulations * objects * 13);
  if (!reader.at_end()) throw std::runtime_error("the request is too long");
  return r;
}

inline bool read_doubles(std::vector<double>& data) {
  double length = 0;
  if (std::fread(&length, sizeof length, 1, stdin) != 1) return false;
  data.resize(static_cast<std::size_t>(length));
  return std::fread(data.data(), sizeof(double), data.size(), stdin) == data.size();
}

inline void write_doubles(const std::vector<double>& data) {
  const double length = static_cast<double>(data.size());
  std::fwrite(&length, sizeof length, 1, stdout);
  std::fwrite(data.data(), sizeof(double), data.size(), stdout);
  std::fflush(stdout);
}

// Answer all requests; returns the program's exit status.
template <typename Answer>
int serve(Answer answer) {
  try {
    for (std::vector<double> data; read_doubles(data);) write_doubles(answer(parse(data)));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
