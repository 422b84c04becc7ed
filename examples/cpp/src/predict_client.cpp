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
  auto future = client->async_send_request(request);
  const auto timeout = std::chrono::minutes(3);  // a first request may wait for compilation for two
  if (rclcpp::spin_until_future_complete(node, future, timeout) != rclcpp::FutureReturnCode::SUCCESS) {
    client->remove_pending_request(future);
    std::cerr << "no answer came in time\n";
    return 1;
  }
  const auto response = future.get();
  std::cout << can_and_brick::text(*response);
  rclcpp::shutdown();
  return response->result.error_code;
}
