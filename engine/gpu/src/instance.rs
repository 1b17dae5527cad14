//! Vulkan's instance, and the messages of the validation layer if it is on.

#![expect(unsafe_code, reason = "Vulkan's edge")]

use crate::error::{Call, EngineError};
use ash::{ext, vk};
use std::ffi::{CStr, c_char, c_void};
use std::sync::{Mutex, OnceLock, PoisonError};

const VALIDATION_LAYER: &CStr = c"VK_LAYER_KHRONOS_validation";

/// Whether the validation layer is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Validation {
    /// Off.
    Off,
    /// On, with core checks and synchronisation checks. Shaders stay as they are: what GPU-assisted checks write into large
    /// ones takes the software driver minutes to compile.
    Calls,
    /// On, with core checks, GPU-assisted checks and synchronisation checks. Messages are kept: see
    /// [`crate::Device::validation_messages`].
    On,
}

impl Validation {
    /// `Calls` if the environment variable `ESAAC_VALIDATION` is `calls`; `On` if it is anything else but `0`.
    #[must_use]
    pub fn from_env() -> Self {
        match std::env::var_os("ESAAC_VALIDATION") {
            Some(value) if value == "calls" => Validation::Calls,
            Some(value) if value != "0" => Validation::On,
            _ => Validation::Off,
        }
    }
}

/// The instance that was dropped first. It is never destroyed, so the driver stays loaded: without an instance the loader
/// unloads it, and NVIDIA's driver can be loaded only so many times in a process.
static KEPT: OnceLock<(ash::Entry, ash::Instance)> = OnceLock::new();

type Messages = Mutex<Vec<String>>;

/// Vulkan's instance, with the messages of the validation layer.
pub(crate) struct Instance {
    entry: ash::Entry,
    raw: ash::Instance,
    validation: Validation,
    debug: Option<(ext::debug_utils::Instance, vk::DebugUtilsMessengerEXT)>,
    messages: Box<Messages>,
}

/// Collects the messages of the validation layer.
///
/// # Safety
/// Called by the loader with a valid callback struct and the `Messages` registered with it.
unsafe extern "system" fn on_message(
    _severity: vk::DebugUtilsMessageSeverityFlagsEXT,
    _kind: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: `user` is the boxed `Messages` of the instance, which outlives the messenger; `data`
    // and its message are valid for this call.
    let (messages, text) = unsafe {
        let message: *const c_char = (*data).p_message;
        (&*user.cast::<Messages>(), CStr::from_ptr(message).to_string_lossy().into_owned())
    };
    messages.lock().unwrap_or_else(PoisonError::into_inner).push(text);
    vk::FALSE
}

impl Instance {
    pub(crate) fn new(validation: Validation) -> Result<Self, EngineError> {
        // SAFETY: loading the system's Vulkan loader runs its initialisers, which are trusted.
        let entry = unsafe { ash::Entry::load() }.map_err(EngineError::NoLoader)?;
        let application = vk::ApplicationInfo::default()
            .application_name(c"esaac")
            .engine_name(c"esaac")
            .api_version(vk::API_VERSION_1_3);
        let mut layers: Vec<*const c_char> = Vec::new();
        let mut extensions: Vec<*const c_char> = Vec::new();
        if validation != Validation::Off {
            // SAFETY: the entry is loaded.
            let present = unsafe { entry.enumerate_instance_layer_properties() }
                .call("vkEnumerateInstanceLayerProperties")?;
            if !present.iter().any(|l| l.layer_name_as_c_str() == Ok(VALIDATION_LAYER)) {
                return Err(EngineError::NoValidationLayer);
            }
            layers.push(VALIDATION_LAYER.as_ptr());
            extensions.push(ext::debug_utils::NAME.as_ptr());
            extensions.push(ext::validation_features::NAME.as_ptr());
        }
        let enabled = [
            vk::ValidationFeatureEnableEXT::SYNCHRONIZATION_VALIDATION,
            vk::ValidationFeatureEnableEXT::GPU_ASSISTED,
            vk::ValidationFeatureEnableEXT::GPU_ASSISTED_RESERVE_BINDING_SLOT,
        ];
        let enabled = if validation == Validation::On { &enabled[..] } else { &enabled[..1] };
        let mut features = vk::ValidationFeaturesEXT::default().enabled_validation_features(enabled);
        let mut info = vk::InstanceCreateInfo::default()
            .application_info(&application)
            .enabled_layer_names(&layers)
            .enabled_extension_names(&extensions);
        if validation != Validation::Off {
            info = info.push_next(&mut features);
        }
        // SAFETY: every pointer in `info` lives until the call returns.
        let raw = unsafe { entry.create_instance(&info, None) }.map_err(|result| match result {
            vk::Result::ERROR_INCOMPATIBLE_DRIVER => EngineError::NoDriver,
            result => EngineError::Vulkan { call: "vkCreateInstance", result },
        })?;
        let mut instance = Instance { entry, raw, validation, debug: None, messages: Box::default() };
        if validation != Validation::Off {
            let debug = ext::debug_utils::Instance::new(&instance.entry, &instance.raw);
            let info = vk::DebugUtilsMessengerCreateInfoEXT::default()
                .message_severity(
                    vk::DebugUtilsMessageSeverityFlagsEXT::WARNING
                        | vk::DebugUtilsMessageSeverityFlagsEXT::ERROR,
                )
                .message_type(vk::DebugUtilsMessageTypeFlagsEXT::VALIDATION)
                .pfn_user_callback(Some(on_message))
                .user_data((&raw const *instance.messages).cast_mut().cast());
            // SAFETY: the callback and the boxed messages outlive the messenger, destroyed in `drop`.
            let messenger = unsafe { debug.create_debug_utils_messenger(&info, None) }
                .call("vkCreateDebugUtilsMessengerEXT")?;
            instance.debug = Some((debug, messenger));
        }
        Ok(instance)
    }
}

impl Instance {
    pub(crate) fn raw(&self) -> &ash::Instance {
        &self.raw
    }

    pub(crate) fn validation(&self) -> Validation {
        self.validation
    }

    /// The validation layer's messages so far.
    pub(crate) fn messages(&self) -> Vec<String> {
        self.messages.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for Instance {
    fn drop(&mut self) {
        // SAFETY: the device made from this instance is gone (it owns the instance), and nothing else
        // uses the messenger.
        unsafe {
            if let Some((debug, messenger)) = self.debug.take() {
                debug.destroy_debug_utils_messenger(messenger, None);
            }
            if KEPT.set((self.entry.clone(), self.raw.clone())).is_err() {
                self.raw.destroy_instance(None);
            }
        }
    }
}
