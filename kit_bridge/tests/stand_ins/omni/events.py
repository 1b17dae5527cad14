"""F8: event streams that hand events to whoever has subscribed, for as long as the subscription is kept."""

import types
import weakref


class Subscription:
    def __init__(self, call):
        self.call = call


class Stream:
    def __init__(self):
        self._subscribed = []

    def create_subscription_to_pop(self, call, name=""):
        subscription = Subscription(call)
        self._subscribed.append(weakref.ref(subscription))
        return subscription

    def push(self, kind=0):
        for reference in list(self._subscribed):
            subscription = reference()
            if subscription is not None:
                subscription.call(types.SimpleNamespace(type=kind))
