#pragma once

#include "mapp/base/rng.h"

#include <cstdint>
#include <memory>
#include <utility>

namespace mapp::memory {

/// An ordered map whose copies are immutable to each other: copying costs nothing, a change copies the way from the
/// root to what it changes and shares the rest. Values that stay are never copied. A treap (Seidel and Aragon 1996).
/// One thread at a time; copies may be used by one thread each.
template <typename Key, typename Value>
class PersistentMap {
 public:
  /// Valid until this map changes. Null when there is none.
  const Value* Find(const Key& key) const {
    const Node* node = root_.get();
    while (node != nullptr) {
      if (key < node->key) {
        node = node->left.get();
      } else if (node->key < key) {
        node = node->right.get();
      } else {
        return node->value.get();
      }
    }
    return nullptr;
  }

  void Set(const Key& key, Value value) {
    auto shared = std::make_shared<const Value>(std::move(value));
    root_ = Find(key) != nullptr ? Replaced(root_, key, std::move(shared))
                                 : Inserted(root_, key, std::move(shared), priorities_.Next());
  }

  /// Nothing happens when there is none.
  void Erase(const Key& key) {
    if (Find(key) != nullptr) root_ = Erased(root_, key);
  }

  /// Calls `visit(key, value)` in ascending order.
  template <typename Visit>
  void ForEach(Visit visit) const {
    Walk(root_.get(), nullptr, [&visit](const Key& key, const Value& value) {
      visit(key, value);
      return true;
    });
  }

  /// Calls `visit(key, value)` in ascending order from the first key that is not less than `from`, until it says false.
  template <typename Visit>
  void ForEachFrom(const Key& from, Visit visit) const {
    Walk(root_.get(), &from, visit);
  }

 private:
  struct Node;
  using Link = std::shared_ptr<const Node>;
  /// Ordered by key from left to right; no node's priority is above its parent's.
  struct Node {
    Key key;
    std::shared_ptr<const Value> value;
    uint64_t priority;
    Link left, right;
  };

  static Link WithLeft(const Node& node, Link left) {
    return std::make_shared<const Node>(Node{node.key, node.value, node.priority, std::move(left), node.right});
  }
  static Link WithRight(const Node& node, Link right) {
    return std::make_shared<const Node>(Node{node.key, node.value, node.priority, node.left, std::move(right)});
  }

  static Link Replaced(const Link& node, const Key& key, std::shared_ptr<const Value> value) {
    if (key < node->key) return WithLeft(*node, Replaced(node->left, key, std::move(value)));
    if (node->key < key) return WithRight(*node, Replaced(node->right, key, std::move(value)));
    return std::make_shared<const Node>(Node{key, std::move(value), node->priority, node->left, node->right});
  }

  static Link Inserted(const Link& node, const Key& key, std::shared_ptr<const Value> value, uint64_t priority) {
    if (node == nullptr || node->priority < priority) {
      auto [less, greater] = Split(node, key);
      return std::make_shared<const Node>(Node{key, std::move(value), priority, std::move(less), std::move(greater)});
    }
    if (key < node->key) return WithLeft(*node, Inserted(node->left, key, std::move(value), priority));
    return WithRight(*node, Inserted(node->right, key, std::move(value), priority));
  }

  static Link Erased(const Link& node, const Key& key) {
    if (key < node->key) return WithLeft(*node, Erased(node->left, key));
    if (node->key < key) return WithRight(*node, Erased(node->right, key));
    return Merged(node->left, node->right);
  }

  /// What is less than `key`, which is not in it, and what is greater.
  static std::pair<Link, Link> Split(const Link& node, const Key& key) {
    if (node == nullptr) return {};
    if (key < node->key) {
      auto [less, greater] = Split(node->left, key);
      return {std::move(less), WithLeft(*node, std::move(greater))};
    }
    auto [less, greater] = Split(node->right, key);
    return {WithRight(*node, std::move(less)), std::move(greater)};
  }

  /// Every key of `less` is less than every one of `greater`.
  static Link Merged(const Link& less, const Link& greater) {
    if (less == nullptr) return greater;
    if (greater == nullptr) return less;
    if (greater->priority < less->priority) return WithRight(*less, Merged(less->right, greater));
    return WithLeft(*greater, Merged(less, greater->left));
  }

  template <typename Visit>
  static bool Walk(const Node* node, const Key* from, Visit&& visit) {
    if (node == nullptr) return true;
    if (from == nullptr || !(node->key < *from)) {
      if (!Walk(node->left.get(), from, visit)) return false;
      if (!visit(node->key, *node->value)) return false;
    }
    return Walk(node->right.get(), from, visit);
  }

  Link root_;
  Rng priorities_{1};  ///< the same at every run
};

}  // namespace mapp::memory
