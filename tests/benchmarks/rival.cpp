// Dynamics of a robot with closed loops as an expert writes it with Pinocchio's C++: recursive Newton-Euler, joint
// Jacobians, of the closures' Jacobian only the columns that are not zero, and one LU decomposition of its dependent
// part. Which rows and columns are independent is known beforehand; nothing is allocated and nothing is checked.
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/rnea.hpp>

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

namespace pin = pinocchio;
using Eigen::Vector3d;
using Map = Eigen::Map<const Eigen::VectorXd>;

namespace {

struct Closure {
    pin::JointIndex joint[2];
    pin::SE3 place[2];
    bool distance;
    int row;
    std::vector<int> columns[2]; // of the tree's velocities that move one end and not the other
};

struct Robot {
    pin::Model model;
    std::unique_ptr<pin::Data> data;
    std::vector<Closure> closures;
    std::vector<int> rows, independent, dependent, actuated;
    Eigen::MatrixXd J, Jd;
    Eigen::VectorXd drift, v, a, right, found;
    Eigen::PartialPivLU<Eigen::MatrixXd> lu;

    // The closures' Jacobian in world axes from joint Jacobians, and their drift if velocities are known.
    void close(bool moving)
    {
        J.setZero();
        for (const Closure &c : closures) {
            Vector3d p[2], n;
            for (int end = 0; end < 2; ++end)
                p[end] = data->oMi[c.joint[end]].act(c.place[end].translation());
            const double length = (p[1] - p[0]).norm();
            if (c.distance)
                n = (p[1] - p[0]) / length;
            for (int end = 0; end < 2; ++end)
                for (const int column : c.columns[end]) {
                    const auto j = data->J.col(column);
                    Vector3d moved = j.head<3>() + j.tail<3>().cross(p[end]);
                    if (end == 0)
                        moved = -moved;
                    if (c.distance)
                        J(c.row, column) += n.dot(moved);
                    else
                        J.col(column).segment<3>(c.row) += moved;
                }
            if (!moving)
                continue;
            Vector3d speed[2], push[2];
            for (int end = 0; end < 2; ++end) {
                const auto &R = data->oMi[c.joint[end]].rotation();
                const Vector3d &at = c.place[end].translation();
                const auto &rate = data->v[c.joint[end]];
                const auto &change = data->a[c.joint[end]];
                const Vector3d here = rate.linear() + rate.angular().cross(at);
                speed[end] = R * here;
                push[end] = R * (change.linear() + change.angular().cross(at) + rate.angular().cross(here));
            }
            if (c.distance) {
                const Vector3d across = speed[1] - speed[0];
                drift(c.row) = n.dot(push[1] - push[0]) + (across.squaredNorm() - std::pow(n.dot(across), 2)) / length;
            } else {
                drift.segment<3>(c.row) = push[1] - push[0];
            }
        }
        for (std::size_t i = 0; i < rows.size(); ++i)
            for (std::size_t k = 0; k < dependent.size(); ++k)
                Jd(i, k) = J(rows[i], dependent[k]);
        lu.compute(Jd);
    }

    // Dependent entries of x from independent ones, with J x + offset = 0.
    void follow(Eigen::VectorXd &x, bool offset)
    {
        for (std::size_t i = 0; i < rows.size(); ++i) {
            double sum = offset ? drift(rows[i]) : 0.0;
            for (const int k : independent)
                sum += J(rows[i], k) * x(k);
            right(i) = -sum;
        }
        found.noalias() = lu.solve(right);
        for (std::size_t k = 0; k < dependent.size(); ++k)
            x(dependent[k]) = found(k);
    }

    // Forces of the actuators from those of the tree.
    void project(double *tau)
    {
        auto &f = data->tau;
        for (std::size_t k = 0; k < dependent.size(); ++k)
            right(k) = f(dependent[k]);
        found.noalias() = lu.transpose().solve(right);
        for (const int k : actuated) {
            double sum = f(k);
            for (std::size_t i = 0; i < rows.size(); ++i)
                sum -= J(rows[i], k) * found(i);
            *tau++ = sum;
        }
    }
};

Robot robot;

} // namespace

extern "C" {

void add_joint(const char *kind, int parent, const double *axis, const double *place, const double *inertia)
{
    const Vector3d direction(axis[0], axis[1], axis[2]);
    pin::SE3 M;
    M.rotation() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(place);
    M.translation() = Vector3d(place[9], place[10], place[11]);
    const std::string what(kind), name = "joint" + std::to_string(robot.model.njoints);
    pin::JointModel joint;
    if (what == "JointModelRX") joint = pin::JointModelRX();
    else if (what == "JointModelRY") joint = pin::JointModelRY();
    else if (what == "JointModelRZ") joint = pin::JointModelRZ();
    else if (what == "JointModelPX") joint = pin::JointModelPX();
    else if (what == "JointModelPY") joint = pin::JointModelPY();
    else if (what == "JointModelPZ") joint = pin::JointModelPZ();
    else if (what == "JointModelRevoluteUnaligned") joint = pin::JointModelRevoluteUnaligned(direction);
    else if (what == "JointModelPrismaticUnaligned") joint = pin::JointModelPrismaticUnaligned(direction);
    else if (what == "JointModelSpherical") joint = pin::JointModelSpherical();
    else if (what == "JointModelFreeFlyer") joint = pin::JointModelFreeFlyer();
    else throw std::runtime_error("no such joint here: " + what);
    const auto id = robot.model.addJoint(parent, joint, M, name);
    const Eigen::Matrix3d I = Eigen::Map<const Eigen::Matrix3d>(inertia + 4); // about the mass centre
    robot.model.appendBodyToJoint(id, pin::Inertia(inertia[0], Vector3d(inertia[1], inertia[2], inertia[3]), I));
}

void add_closure(int distance, int joint1, const double *point1, int joint2, const double *point2)
{
    Closure c;
    const int joints[2] = {joint1, joint2};
    const double *points[2] = {point1, point2};
    c.distance = distance != 0;
    c.row = robot.closures.empty() ? 0 : robot.closures.back().row + (robot.closures.back().distance ? 1 : 3);
    for (int end = 0; end < 2; ++end) {
        c.joint[end] = joints[end];
        c.place[end] = pin::SE3(Eigen::Matrix3d::Identity(), Vector3d(points[end][0], points[end][1], points[end][2]));
        const auto &own = robot.model.supports[joints[end]], &other = robot.model.supports[joints[1 - end]];
        for (const auto joint : own)
            if (joint > 0 && std::find(other.begin(), other.end(), joint) == other.end())
                for (int k = 0; k < robot.model.nvs[joint]; ++k)
                    c.columns[end].push_back(robot.model.idx_vs[joint] + k);
    }
    robot.closures.push_back(c);
}

void begin(const double *gravity, int count, const int *rows, const int *dependent, int motors,
    const int *actuated)
{
    const int nv = robot.model.nv;
    robot.model.gravity.linear() = Vector3d(gravity[0], gravity[1], gravity[2]);
    robot.data = std::make_unique<pin::Data>(robot.model);
    robot.rows.assign(rows, rows + count);
    robot.dependent.assign(dependent, dependent + count);
    robot.actuated.assign(actuated, actuated + motors);
    for (int k = 0; k < nv; ++k)
        if (std::find(dependent, dependent + count, k) == dependent + count)
            robot.independent.push_back(k);
    const int size = robot.closures.back().row + (robot.closures.back().distance ? 1 : 3);
    robot.J = Eigen::MatrixXd::Zero(size, nv);
    robot.Jd = Eigen::MatrixXd::Zero(count, count);
    robot.lu = Eigen::PartialPivLU<Eigen::MatrixXd>(count);
    robot.drift = Eigen::VectorXd::Zero(size);
    robot.right = robot.found = Eigen::VectorXd::Zero(count);
    robot.v = robot.a = Eigen::VectorXd::Zero(nv);
}

// Forces from a configuration and velocities and accelerations of the whole tree.
void inverse_dynamics_bound(double *const *buffers)
{
    const int nq = robot.model.nq, nv = robot.model.nv;
    const Map q(buffers[0], nq), v(buffers[0] + nq, nv), a(buffers[0] + nq + nv, nv);
    pin::rnea(robot.model, *robot.data, q, v, a);
    pin::computeJointJacobians(robot.model, *robot.data, q);
    robot.close(false);
    robot.project(buffers[1]);
}

// Forces, from a configuration and velocities and accelerations of the independent joints only.
void motion_bound(double *const *buffers)
{
    const int nq = robot.model.nq;
    const Map q(buffers[0], nq);
    const double *given = buffers[0] + nq;
    for (const int k : robot.independent)
        robot.v(k) = *given++;
    for (const int k : robot.independent)
        robot.a(k) = *given++;
    pin::computeJointJacobians(robot.model, *robot.data, q);
    robot.close(false);
    robot.follow(robot.v, false);
    static const Eigen::VectorXd none = Eigen::VectorXd::Zero(robot.model.nv);
    pin::forwardKinematics(robot.model, *robot.data, q, robot.v, none);
    robot.close(true);
    robot.follow(robot.a, true);
    pin::rnea(robot.model, *robot.data, q, robot.v, robot.a);
    robot.project(buffers[1]);
}
}
