// Asks the node where a can on its way to a brick will be: the smallest client in C++.
//
// Start the node first (`ros2 run unc_physics unc_physics_node`), then run this
// (`ros2 run unc_physics_example_cpp predict_client`).

#include <chrono>
#include <iostream>
#include <memory>

#include <rclcpp/rclcpp.hpp>

#include "can_and_brick.hpp"

int main(int argc, char ** argv)
{
  using unc_physics_msgs::srv::Predict;

  rclcpp::init(argc, argv);
  const auto node = rclcpp::Node::make_shared("predict_client");
  const auto client = node->create_client<Predict>("/unc_physics/predict");
  if (!client->wait_for_service(std::chrono::seconds(10))) {
    std::cerr << "no node answers on /unc_physics/predict\n";
    return 1;
  }
  const auto request = std::make_shared<Predict::Request>();
  request->request = can_and_brick::request();
  // a first request may wait for compilation for two minutes, and the node answers before with NOT_READY
  const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(3);
  Predict::Response::SharedPtr response;
  do {
    auto future = client->async_send_request(request);
    const auto left = end - std::chrono::steady_clock::now();
    if (rclcpp::spin_until_future_complete(node, future, left) != rclcpp::FutureReturnCode::SUCCESS) {
      client->remove_pending_request(future);
      std::cerr << "no answer came in time\n";
      return 1;
    }
    response = future.get();
  } while (response->result.error_code == can_and_brick::Result::NOT_READY &&
           std::chrono::steady_clock::now() < end);
  std::cout << can_and_brick::text(*response);
  rclcpp::shutdown();
  return response->result.error_code;
}
