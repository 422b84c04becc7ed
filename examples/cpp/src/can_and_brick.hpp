// What the example asks, and how it reads the answer: messages alone, without a node.

#pragma once

#include <cmath>
#include <cstddef>
#include <iomanip>
#include <sstream>
#include <string>

#include <unc_physics_msgs/msg/object_state.hpp>
#include <unc_physics_msgs/msg/prediction_request.hpp>
#include <unc_physics_msgs/msg/result.hpp>
#include <unc_physics_msgs/srv/predict.hpp>

namespace can_and_brick
{

using unc_physics_msgs::msg::ObjectState;
using unc_physics_msgs::msg::PredictionRequest;
using unc_physics_msgs::msg::Result;
using Response = unc_physics_msgs::srv::Predict::Response;

// Sets the diagonal of a 6 x 6 covariance: of three lengths, or velocities, and of three angles.
template<typename Covariance>
void set_stds(Covariance & covariance, double linear, double angular)
{
  for (std::size_t k = 0; k < 6; ++k) {
    const double std = k < 3 ? linear : angular;
    covariance[7 * k] = std * std;
  }
}

// A can on its way to a brick; the physics is the node's.
inline PredictionRequest request()
{
  ObjectState can;
  can.id = can.model = "can";  // with the mass of its model
  can.pose.pose.position.x = -0.2;  // of the model's own origin [m]
  can.pose.pose.position.z = 0.01;
  can.twist.twist.linear.x = 0.5;  // [m/s]
  set_stds(can.pose.covariance, 0.005, 0.02);  // [m], [rad], about fixed axes
  can.twist.covariance[0] = -1.0;  // unknown: the node's default

  ObjectState brick;
  brick.id = brick.model = "brick";
  brick.kind = ObjectState::FIXED;

  PredictionRequest request;
  request.scene.objects = {can, brick};
  request.horizon.nanosec = 500'000'000;
  request.trajectory_period.nanosec = 100'000'000;
  request.propagator = "sigma_points";
  return request;
}

// The can's position and its standard deviations at each time, or what went wrong.
inline std::string text(const Response & response)
{
  std::ostringstream out;
  if (response.result.error_code != Result::NONE) {
    out << "error " << response.result.error_code << ": " << response.result.error_msg << "\n";
    return out.str();
  }
  out << std::fixed << std::setprecision(3);
  for (const auto & state : response.prediction.objects.at(0).states) {
    const auto & time = state.time_from_start;
    const auto & p = state.pose.pose.position;
    const auto & C = state.pose.covariance;
    out << time.sec + 1e-9 * time.nanosec << " s: (" << p.x << ", " << p.y << ", " << p.z << ") m +- ("
        << std::sqrt(C[0]) << ", " << std::sqrt(C[7]) << ", " << std::sqrt(C[14]) << ") m\n";
  }
  return out.str();
}

}  // namespace can_and_brick
