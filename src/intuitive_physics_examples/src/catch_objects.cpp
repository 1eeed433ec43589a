// Asks the predictor once a second where a hand could best catch each object, and when.

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "intuitive_physics_msgs/msg/region.hpp"
#include "intuitive_physics_msgs/msg/result_code.hpp"
#include "intuitive_physics_msgs/msg/trajectory_distribution.hpp"
#include "intuitive_physics_msgs/srv/query.hpp"
#include "rclcpp/rclcpp.hpp"

using intuitive_physics_msgs::msg::Region;
using intuitive_physics_msgs::msg::ResultCode;
using intuitive_physics_msgs::msg::TrajectoryDistribution;
using intuitive_physics_msgs::srv::Query;

class CatchObjects : public rclcpp::Node
{
public:
  CatchObjects() : Node("catch_objects")
  {
    // What the hand can reach: a box in the frame of the predictions, m.
    center_ = declare_parameter("center", std::vector<double>{0.0, 0.0, 0.5});
    size_ = declare_parameter("size", std::vector<double>{2.0, 2.0, 1.0});
    // How far from its centre it still catches, m, and how long it takes to move, s.
    reach_ = declare_parameter("reach", 0.1);
    earliest_ = declare_parameter("earliest", 0.2);
    query_ = create_client<Query>("predictor_node/query");
    subscription_ = create_subscription<TrajectoryDistribution>(
      "intuitive_physics/predictions", 1, [this](TrajectoryDistribution::ConstSharedPtr message) { newest_ = message; });
    timer_ = create_wall_timer(std::chrono::seconds(1), [this] { ask(); });
  }

private:
  void ask()
  {
    if (!newest_ || !query_->service_is_ready()) {
      RCLCPP_INFO_ONCE(get_logger(), "nothing is predicted yet");
      return;
    }
    for (const auto & trajectory : newest_->objects) {
      const std::string id = trajectory.object_id;
      query_->async_send_request(
        request(id), [this, id](rclcpp::Client<Query>::SharedFuture future) { tell(id, *future.get()); });
    }
    newest_.reset();
  }

  Query::Request::SharedPtr request(const std::string & id) const
  {
    auto asked = std::make_shared<Query::Request>();
    asked->event = Query::Request::INTERCEPTS;
    asked->object_id = id;
    asked->region.kind = Region::BOX;
    auto & place = asked->region.pose.position;
    place.x = center_.at(0), place.y = center_.at(1), place.z = center_.at(2);
    auto & edges = asked->region.edge_lengths;
    edges.x = size_.at(0), edges.y = size_.at(1), edges.z = size_.at(2);
    asked->reach = reach_;
    asked->earliest = earliest_;
    return asked;
  }

  void tell(const std::string & id, const Query::Response & answer) const
  {
    if (answer.result.value != ResultCode::OK) {
      RCLCPP_WARN(get_logger(), "%s: %s", id.c_str(), answer.result.message.c_str());
    } else if (answer.probability == 0.0) {
      RCLCPP_INFO(get_logger(), "%s cannot be caught", id.c_str());
    } else {
      RCLCPP_INFO(
        get_logger(), "catch %s at (%.3f, %.3f, %.3f) m of %s in %.3f s: %.0f%%", id.c_str(),
        answer.position.x, answer.position.y, answer.position.z, answer.header.frame_id.c_str(),
        answer.time, 100.0 * answer.probability);
    }
  }

  std::vector<double> center_, size_;
  double reach_, earliest_;
  TrajectoryDistribution::ConstSharedPtr newest_;
  rclcpp::Client<Query>::SharedPtr query_;
  rclcpp::Subscription<TrajectoryDistribution>::SharedPtr subscription_;
  rclcpp::TimerBase::SharedPtr timer_;
};

int main(int argc, char ** argv)
{
  rclcpp::init(argc, argv);
  rclcpp::spin(std::make_shared<CatchObjects>());
  rclcpp::shutdown();
  return 0;
}
