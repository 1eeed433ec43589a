// Rolls out worlds in ODE, for benchmarks/peers/ode.py; rollout_request.h says what it reads.
//
// The flags: whether bodies at rest sleep, whether boxes have rolling friction too.

#include <ode/ode.h>

#include <chrono>
#include <cmath>
#include <cstdarg>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <utility>
#include <vector>

#include "rollout_request.h"

namespace {

static_assert(sizeof(dReal) == sizeof(double), "this ODE was built for single precision");

constexpr int kMostContacts = 8;
constexpr double kSlipSpeed = 0.01;   // m/s, above which a contact slides: μ_d instead of μ_s
constexpr double kBounceSpeed = 0.1;  // m/s, below which ODE's contacts do not bounce; g · 10 ms

// One ODE world, used for all simulations of a request.
class World {
 public:
  explicit World(const Request& request)
      : request_(request),
        world_(dWorldCreate()),
        space_(dSimpleSpaceCreate(nullptr)),  // quicker than the hash space up to 20 objects
        contacts_(dJointGroupCreate(0)) {
    dWorldSetGravity(world_, request.gravity[0], request.gravity[1], request.gravity[2]);
    dWorldSetAutoDisableFlag(world_, request.flags[0]);
    for (int i = 0; i < request.n_objects; ++i) add_object(i);
    for (int p = 0; p < request.n_planes; ++p) add_plane(p);
  }

  ~World() {
    dJointGroupDestroy(contacts_);
    dSpaceDestroy(space_);
    dWorldDestroy(world_);
  }

  World(const World&) = delete;
  World& operator=(const World&) = delete;

  void simulate(const double* starts, double* positions) {
    reset(starts);
    for (int step = 0; step < request_.n_steps; ++step) {
      dSpaceCollide(space_, this, &World::near);
      dWorldQuickStep(world_, request_.step);
      dJointGroupEmpty(contacts_);
      for (std::size_t i = 0; i < bodies_.size(); ++i) {
        const dReal* at = dBodyGetPosition(bodies_[i]);
        double* row = positions + 3 * (i * request_.n_steps + step);
        for (int axis = 0; axis < 3; ++axis) row[axis] = at[axis];
      }
    }
  }

 private:
  void add_object(int i) {
    const double* object = request_.objects + 8 * i;
    dBodyID body = dBodyCreate(world_);
    dMass mass;
    dMassSetParameters(&mass, object[4], 0, 0, 0, object[5], object[6], object[7], 0, 0, 0);
    dBodySetMass(body, &mass);
    dGeomID geom = nullptr;
    switch (static_cast<int>(object[0])) {
      case kSphere: geom = dCreateSphere(space_, object[1]); break;
      case kBox: geom = dCreateBox(space_, object[1], object[2], object[3]); break;
      case kCapsule: geom = dCreateCapsule(space_, object[1], object[2]); break;
      default: throw std::runtime_error("the request has an unknown shape");
    }
    dGeomSetBody(geom, body);
    name(geom, i);
    bodies_.push_back(body);
  }

  void add_plane(int p) {
    const double* plane = request_.planes + 4 * p;
    dGeomID geom = dCreatePlane(space_, plane[0], plane[1], plane[2], plane[3]);
    // Planes do not ask whether they touch one another.
    dGeomSetCategoryBits(geom, 2);
    dGeomSetCollideBits(geom, 1);
    name(geom, request_.n_objects + p);
  }

  // Objects come first, then planes: the index of a row or column of the pair coefficients.
  static void name(dGeomID geom, int index) {
    dGeomSetData(geom, reinterpret_cast<void*>(static_cast<std::intptr_t>(index)));
  }
  static int index(dGeomID geom) {
    return static_cast<int>(reinterpret_cast<std::intptr_t>(dGeomGetData(geom)));
  }

  void reset(const double* starts) {
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      const double* s = starts + 13 * i;
      const dQuaternion turn = {s[6], s[3], s[4], s[5]};
      dBodySetPosition(bodies_[i], s[0], s[1], s[2]);
      dBodySetQuaternion(bodies_[i], turn);
      dBodySetLinearVel(bodies_[i], s[7], s[8], s[9]);
      dBodySetAngularVel(bodies_[i], s[10], s[11], s[12]);
      dBodySetForce(bodies_[i], 0, 0, 0);
      dBodySetTorque(bodies_[i], 0, 0, 0);
      dBodyEnable(bodies_[i]);
    }
    dRandSetSeed(0);  // the quick stepper shuffles its rows
  }

  static void near(void* self, dGeomID a, dGeomID b) { static_cast<World*>(self)->touch(a, b); }

  void touch(dGeomID a, dGeomID b) {
    int row = index(a), column = index(b);
    if (row >= request_.n_objects) std::swap(row, column);
    const double* pair =
        request_.coefficients + 4 * (row * (request_.n_objects + request_.n_planes) + column);
    dBodyID body_a = dGeomGetBody(a), body_b = dGeomGetBody(b);
    dContact contacts[kMostContacts];
    const int count = dCollide(a, b, kMostContacts, &contacts[0].geom, sizeof(dContact));
    for (int i = 0; i < count; ++i) {
      dSurfaceParameters& surface = contacts[i].surface;
      surface.mode = dContactBounce | dContactApprox1;
      surface.mu = pair[0];
      const double speed = slip(contacts[i].geom, body_a, body_b, contacts[i].fdir1);
      if (speed > kSlipSpeed) {
        // ODE bounds friction on two axes each; along the slip the bound is exact.
        surface.mode |= dContactFDir1;
        surface.mu = pair[1];
      }
      surface.bounce = pair[3];
      surface.bounce_vel = kBounceSpeed;
      if (pair[2] > 0.0 && (request_.flags[1] || (round(a) && round(b)))) {
        surface.mode |= dContactRolling;
        surface.rho = pair[2];
      }
      dJointAttach(dJointCreateContact(world_, contacts_, &contacts[i]), body_a, body_b);
    }
  }

  static bool round(dGeomID geom) { return dGeomGetClass(geom) != dBoxClass; }

  // Speed at which two surfaces pass one another along their contact, and its direction.
  static double slip(const dContactGeom& contact, dBodyID a, dBodyID b, dReal* direction) {
    double v[3] = {0, 0, 0};
    for (const auto& [body, sign] : {std::pair{a, 1.0}, std::pair{b, -1.0}}) {
      if (!body) continue;
      dVector3 own;
      dBodyGetPointVel(body, contact.pos[0], contact.pos[1], contact.pos[2], own);
      for (int axis = 0; axis < 3; ++axis) v[axis] += sign * own[axis];
    }
    const dReal* n = contact.normal;
    const double along = v[0] * n[0] + v[1] * n[1] + v[2] * n[2];
    for (int axis = 0; axis < 3; ++axis) v[axis] -= along * n[axis];
    const double speed = std::hypot(v[0], v[1], v[2]);
    for (int axis = 0; axis < 3; ++axis) direction[axis] = v[axis] / speed;
    return speed;
  }

  const Request& request_;
  dWorldID world_;
  dSpaceID space_;
  dJointGroupID contacts_;
  std::vector<dBodyID> bodies_;
};

std::vector<double> answer(const Request& request) {
  const std::size_t size = std::size_t{3} * request.n_objects * request.n_steps;
  std::vector<double> result(1 + size * request.n_simulations);
  World world(request);
  const auto start = std::chrono::steady_clock::now();
  for (int s = 0; s < request.n_simulations; ++s) {
    world.simulate(request.starts + std::size_t{13} * request.n_objects * s, &result[1 + size * s]);
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - start;
  result[0] = took.count();
  return result;
}

void stop_on_error(int number, const char* message, std::va_list arguments) {
  std::fprintf(stderr, "ODE error %d: ", number);
  std::vfprintf(stderr, message, arguments);
  std::fputc('\n', stderr);
  std::exit(1);
}

}  // namespace

int main() {
  dInitODE2(0);
  dSetErrorHandler(stop_on_error);
  dSetMessageHandler(stop_on_error);
  const int status = serve(answer);
  dCloseODE();
  return status;
}
