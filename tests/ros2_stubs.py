"""What ROS 2 would bring, as far as the generated package uses it: messages go in and out as lines of text.

A line in is ``topic;names;positions;velocities;efforts``, with commas within; a line out is the same with a
stamp, or ``topic;numbers`` of an array, or ``warning;words`` and ``info;words``. Parameters are given as to
ROS's programs: ``--ros-args -p name:=value``.
"""

from __future__ import annotations

import json
from pathlib import Path

RCLCPP = r"""
#pragma once
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <map>
#include <memory>
#include <sstream>
#include <string>
#include <vector>
#include "sensor_msgs/msg/joint_state.hpp"
#include "std_msgs/msg/float64_multi_array.hpp"

namespace rclcpp
{
inline std::map<std::string, std::string> & parameters()
{
  static std::map<std::string, std::string> found;
  return found;
}
inline std::map<std::string, std::function<void(const sensor_msgs::msg::JointState &)>> & heard()
{
  static std::map<std::string, std::function<void(const sensor_msgs::msg::JointState &)>> found;
  return found;
}
inline void init(int argc, char ** argv)
{
  for (int i = 1; i + 1 < argc; ++i) {
    const std::string text = argv[i + 1];
    if (std::string(argv[i]) == "-p") {
      parameters()[text.substr(0, text.find(":="))] = text.substr(text.find(":=") + 2);
    }
  }
}
inline void shutdown() {}

inline void write(const std::vector<double> & row)
{
  for (std::size_t i = 0; i < row.size(); ++i) {
    std::printf("%s%.17g", i == 0 ? "" : ",", row[i]);
  }
}
inline void write(const sensor_msgs::msg::JointState & m)
{
  std::printf("%d.%u;", m.header.stamp.sec, m.header.stamp.nanosec);
  for (std::size_t i = 0; i < m.name.size(); ++i) {
    std::printf("%s%s", i == 0 ? "" : ",", m.name[i].c_str());
  }
  for (const auto * row : {&m.position, &m.velocity, &m.effort}) {
    std::printf(";");
    write(*row);
  }
}
inline void write(const std_msgs::msg::Float64MultiArray & m) {write(m.data);}

template<typename M>
struct Publisher
{
  std::string topic;
  void publish(const M & message)
  {
    std::printf("%s;", topic.c_str());
    write(message);
    std::printf("\n");
  }
};
template<typename M>
struct Subscription {};

struct Logger {};

class Node
{
public:
  explicit Node(const std::string & name) {std::printf("node;%s\n", name.c_str());}
  virtual ~Node() = default;
  template<typename T>
  T declare_parameter(const std::string & name, const T & value)
  {
    const auto found = parameters().find(name);
    return found == parameters().end() ? value : T(found->second);
  }
  template<typename M>
  std::shared_ptr<Publisher<M>> create_publisher(const std::string & topic, std::size_t)
  {
    auto made = std::make_shared<Publisher<M>>();
    made->topic = topic;
    return made;
  }
  template<typename M, typename F>
  std::shared_ptr<Subscription<M>> create_subscription(const std::string & topic, std::size_t, F && call)
  {
    heard()[topic] = call;
    return std::make_shared<Subscription<M>>();
  }
  Logger get_logger() const {return {};}
};

inline std::vector<std::string> split(const std::string & text, char sign)
{
  std::vector<std::string> found;
  std::istringstream stream(text + sign);
  for (std::string part; std::getline(stream, part, sign); ) {
    found.push_back(part);
  }
  return found;
}
inline std::vector<double> numbers(const std::string & text)
{
  std::vector<double> found;
  if (!text.empty()) {
    for (const auto & part : split(text, ',')) {
      found.push_back(std::strtod(part.c_str(), nullptr));
    }
  }
  return found;
}
inline void spin(const std::shared_ptr<Node> &)
{
  for (std::string line; std::getline(std::cin, line); ) {
    const auto parts = split(line, ';');
    sensor_msgs::msg::JointState message;
    message.header.stamp.sec = 12;
    message.header.stamp.nanosec = 34;
    message.name = split(parts.at(1), ',');
    message.position = numbers(parts.at(2));
    message.velocity = numbers(parts.at(3));
    message.effort = numbers(parts.at(4));
    heard().at(parts.at(0))(message);
  }
}
}  // namespace rclcpp
#define RCLCPP_WARN(logger, ...) \
  ((void)(logger), std::printf("warning;"), std::printf(__VA_ARGS__), std::printf("\n"))
#define RCLCPP_INFO(logger, ...) \
  ((void)(logger), std::printf("info;"), std::printf(__VA_ARGS__), std::printf("\n"))
"""

JOINT_STATE = r"""
#pragma once
#include <cstdint>
#include <string>
#include <vector>
namespace builtin_interfaces::msg
{
struct Time {std::int32_t sec = 0; std::uint32_t nanosec = 0;};
}
namespace std_msgs::msg
{
struct Header {builtin_interfaces::msg::Time stamp; std::string frame_id;};
}
namespace sensor_msgs::msg
{
struct JointState
{
  std_msgs::msg::Header header;
  std::vector<std::string> name;
  std::vector<double> position, velocity, effort;
};
}
"""

ARRAY = r"""
#pragma once
#include <cstdint>
#include <string>
#include <vector>
namespace std_msgs::msg
{
struct MultiArrayDimension {std::string label; std::uint32_t size = 0, stride = 0;};
struct MultiArrayLayout {std::vector<MultiArrayDimension> dim; std::uint32_t data_offset = 0;};
struct Float64MultiArray {MultiArrayLayout layout; std::vector<double> data;};
}
"""

CONFIGS = {
    "ament_cmake": "macro(ament_package)\nendmacro()\n",
    "rclcpp": "add_library(rclcpp::rclcpp INTERFACE IMPORTED)\n"
    'target_include_directories(rclcpp::rclcpp INTERFACE "${CMAKE_CURRENT_LIST_DIR}/../../include")\n',
    "sensor_msgs": "set(sensor_msgs_TARGETS rclcpp::rclcpp)\n",
    "std_msgs": "set(std_msgs_TARGETS rclcpp::rclcpp)\n",
}

PYTHON = {
    "rclpy/__init__.py": """
import sys
from sensor_msgs.msg import JointState

HEARD, PARAMETERS = {}, {}


def init(args):
    for option, text in zip(args, args[1:]):
        if option == "-p":
            name, _, value = text.partition(":=")
            PARAMETERS[name] = value


def spin(node):
    for line in sys.stdin:
        topic, names, *rows = line.rstrip("\\n").split(";")
        message = JointState()
        message.header.stamp.sec, message.header.stamp.nanosec = 12, 34
        message.name = names.split(",")
        message.position, message.velocity, message.effort = (
            [float(x) for x in row.split(",")] if row else [] for row in rows
        )
        HEARD[topic](message)


def try_shutdown():
    pass
""",
    "rclpy/executors.py": "class ExternalShutdownException(Exception):\n    pass\n",
    "rclpy/node.py": """
import rclpy
from sensor_msgs.msg import JointState


class Publisher:
    def __init__(self, topic):
        self.topic = topic

    def publish(self, message):
        if isinstance(message, JointState):
            stamp = message.header.stamp
            rows = [message.position, message.velocity, message.effort]
            parts = [f"{stamp.sec}.{stamp.nanosec}", ",".join(message.name)]
        else:
            rows, parts = [message.data], []
        print(self.topic, *parts, *(",".join(format(x, ".17g") for x in row) for row in rows), sep=";")


class Logger:
    def warning(self, words):
        print("warning", words, sep=";")

    def info(self, words):
        print("info", words, sep=";")


class Parameter:
    def __init__(self, value):
        self.value = value


class Node:
    def __init__(self, name):
        print("node", name, sep=";")

    def declare_parameter(self, name, value):
        return Parameter(rclpy.PARAMETERS.get(name, value))

    def create_publisher(self, kind, topic, depth):
        return Publisher(topic)

    def create_subscription(self, kind, topic, call, depth):
        rclpy.HEARD[topic] = call

    def get_logger(self):
        return Logger()
""",
    "sensor_msgs/__init__.py": "",
    "sensor_msgs/msg.py": """
from types import SimpleNamespace


class JointState:
    def __init__(self):
        self.header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id="")
        self.name, self.position, self.velocity, self.effort = [], [], [], []
""",
    "std_msgs/__init__.py": "",
    "std_msgs/msg.py": "class Float64MultiArray:\n    def __init__(self):\n        self.data = []\n",
    "ament_index_python/__init__.py": "",
    "ament_index_python/packages.py": """
import os


def get_package_prefix(name):
    return os.environ["PREFIX_OF_" + name]


def get_package_share_directory(name):
    return os.path.join(get_package_prefix(name), "share", name)
""",
    "launch/__init__.py": """
class LaunchDescription:
    def __init__(self, entities):
        self.entities = entities
""",
    "launch/actions.py": """
class DeclareLaunchArgument:
    def __init__(self, name, *, default_value, description):
        self.name, self.default = name, default_value
""",
    "launch/substitutions.py": """
class LaunchConfiguration:
    def __init__(self, name):
        self.name = name


class Command:
    def __init__(self, parts):
        self.parts = parts
""",
    "launch/conditions.py": """
class IfCondition:
    wanted = True

    def __init__(self, value):
        self.value = value


class UnlessCondition(IfCondition):
    wanted = False
""",
    "launch_ros/__init__.py": "",
    "launch_ros/actions.py": """
class Node:
    def __init__(
        self, *, executable, package, arguments=(), parameters=(), remappings=(), condition=None, output="log"
    ):
        self.__dict__.update(locals())
""",
    "launch_ros/parameter_descriptions.py": """
class ParameterValue:
    def __init__(self, value, *, value_type):
        self.value, self.value_type = value, value_type
""",
}

LAUNCHED = """
import importlib.util, json, sys

spec = importlib.util.spec_from_file_location("launched", sys.argv[1])
module = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
given = dict(pair.split(":=") for pair in sys.argv[2:])
entities = module.generate_launch_description().entities
values = {}
for one in entities:
    if type(one).__name__ == "DeclareLaunchArgument":
        values[one.name] = given.pop(one.name, one.default)
assert not given, given


def plain(value):
    kind = type(value).__name__
    if kind == "LaunchConfiguration":
        return values[value.name]
    if kind == "Command":
        return "".join(map(plain, value.parts))
    if kind == "ParameterValue":
        return plain(value.value)
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, tuple):
        return [plain(one) for one in value]
    if isinstance(value, list):
        parts = [plain(one) for one in value]
        mixed = any(type(one).__name__ == "LaunchConfiguration" for one in value)
        return "".join(parts) if mixed else parts
    return value


def runs(node):
    return node.condition is None or (plain(node.condition.value) == "true") == node.condition.wanted


nodes = [one for one in entities if type(one).__name__ == "Node"]
names = ("package", "executable", "arguments", "parameters", "remappings")
print(json.dumps([{name: plain(getattr(one, name)) for name in names} for one in nodes if runs(one)]))
"""
"""A program that executes a launch file: the nodes that it starts, as JSON."""


def write(folder: Path) -> Path:
    """Write the headers and CMake packages into ``prefix``, the Python modules into ``python``."""
    prefix = folder / "prefix"
    texts = {
        "include/rclcpp/rclcpp.hpp": RCLCPP,
        "include/sensor_msgs/msg/joint_state.hpp": JOINT_STATE,
        "include/std_msgs/msg/float64_multi_array.hpp": ARRAY,
        **{f"share/{name}/{name}Config.cmake": text for name, text in CONFIGS.items()},
    }
    found = {prefix / name: text for name, text in texts.items()}
    found |= {folder / "python" / name: text for name, text in PYTHON.items()}
    found[folder / "launched.py"] = LAUNCHED
    for path, text in found.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text.lstrip("\n"), encoding="utf-8")
    return prefix


def nodes(text: str) -> list[dict]:
    """What `LAUNCHED` printed."""
    return json.loads(text)
